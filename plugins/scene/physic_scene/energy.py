"""The engine's preset "default" for bodies whose place several photos show, with their floor and
their contact.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import torch

from physic_core.engine.contact.method import ContactStageMethod, Touch
from physic_core.engine.contact.partner import HIDDEN
from physic_core.engine.placement.method import Fit, PlacementStageMethod
from physic_core.engine.presets import DefaultJointStage
from physic_core.engine.scene.method import SceneStageMethod
from physic_core.engine.settings import EngineSettings
from physic_core.errors import ConfigError
from physic_core.geometry import pixel_rays
from physic_core.types import ShortRepr

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.engine.contact.distances import Distances
    from physic_core.engine.ground.floor import FloorEvidence
    from physic_core.engine.placement.terms import PlacementProblem
    from physic_core.engine.scene.method import Cameras
    from physic_core.engine.state import State
    from physic_core.geometry import FloorSearch
    from physic_core.types import Plane

_LEAST_SLOPE = 0.15  # of a ray to the floor, at the horizon
_MOST_MOVED = 1.6  # factor on a depth
_KEYPOINT = 0.02
_OUTLIER = 1.5
"""Expected errors of the keypoints of all photos in stage 3, which include those of the cameras, as
a share of the stature in px, and how many of them make an outlier. The errors and the
regularisation of a single photo bend bodies until they fit cameras that do not agree: 35 instead of
31 mm PA-MPJPE on eight worlds.
"""


@dataclass(frozen=True, eq=False)
class OtherViews(ShortRepr):
    """Results of the single photos on N people and the floor.

    Attributes:
        is_placed: (N,) bool, people whose place several photos show.
        contact: (N, V) sum of the probabilities of contact by the single photos that show each
            person.
        photo_count: (N,) their number.
        floors: of the single reference photo, at the solved scale, and of all photos; None if the
            reference photo or all others have no floor.
        scale_is_known: whether known cameras give the scale of the scene, which then stays.
    """

    is_placed: Tensor
    contact: Tensor
    photo_count: Tensor
    floors: tuple[Plane, Plane] | None = None
    scale_is_known: bool = False


@dataclass(frozen=True)
class ViewsScene(SceneStageMethod):
    """Stage 1 of preset "default", with the floor of all photos."""

    views: OtherViews | None = None
    """Evidence of the other cameras."""

    def place_on_rays(
        self, points: Tensor, valid: Tensor, cameras: Cameras
    ) -> tuple[Tensor, Tensor]:
        """Return the metric points (H, W, 3), moved along their rays as the floor moves, and the
        camera (3, 3).
        """
        placed, camera = super().place_on_rays(points, valid, cameras)
        if self.views is None or self.views.floors is None:
            return placed, camera
        rays = pixel_rays(placed.shape[0], placed.shape[1], camera).to(placed)
        before, after = self.views.floors
        # Nearer to the horizon, a small turn of the floor would move far points without bound.
        slopes = [
            (-(rays @ rays.new_tensor(plane.normal))).clamp(min=_LEAST_SLOPE)
            for plane in (before, after)
        ]
        factor = after.offset / before.offset * slopes[0] / slopes[1]
        return placed * factor.clamp(1 / _MOST_MOVED, _MOST_MOVED)[..., None], camera

    def search_floor(
        self, points: Tensor, valid: Tensor, surface: Tensor, evidence: FloorEvidence
    ) -> FloorSearch:
        """Find the floor, and return the plane of all photos in its place."""
        search = super().search_floor(points, valid, surface, evidence)
        if self.views is None or self.views.floors is None or search.plane is None:
            return search
        floor = self.views.floors[1]
        normal = search.plane.normal.new_tensor(floor.normal)
        return replace(search, plane=replace(search.plane, normal=normal, offset=floor.offset))


@dataclass(frozen=True)
class ViewsPlacement(PlacementStageMethod):
    """Stage 2 of preset "default", which does not move people whose place several photos show."""

    views: OtherViews | None = None
    """Evidence of the other cameras."""

    def fit(self, person: PlacementProblem) -> Fit:
        """Place one person; people of known place whom the photo does not show stay there."""
        hidden = not person.mask.any() and bool(torch.isfinite(person.vertices).all())
        return Fit() if hidden and self._is_placed(person) else super().fit(person)

    def finish(self, person: PlacementProblem, fit: Fit) -> Tensor:
        """Return x (4,), without a translation for people of known place."""
        placed = self._is_placed(person)
        return torch.cat([torch.zeros_like(fit.x[:3]), fit.x[3:]]) if placed else fit.x

    def _is_placed(self, person: PlacementProblem) -> bool:
        assert self.views is not None
        return bool(self.views.is_placed[person.row])


# Least mean probability of a vertex in contact: of four worlds with four views, 0.4 has the best
# F1, and 0.35 has 0.01 less.
_THRESHOLD = 0.4


@dataclass(frozen=True)
class ViewsContact(ContactStageMethod):
    """Stage 4 of preset "default", with the mean probability over the solution and all single
    photos.
    """

    views: OtherViews | None = None
    """Evidence of the other cameras."""

    def find_touch(self, state: State, near: Distances) -> Touch:
        """Return the contacts by the mean probability, for people whom several photos show."""
        assert self.views is not None
        own = super().find_touch(state, near)
        photos = self.views.photo_count
        assert own.probability is not None
        probability = (own.probability + self.views.contact.to(own.probability)) / (1 + photos)[
            :, None
        ]
        reach = torch.where(torch.isfinite(near.by_kind), near.by_kind.abs(), torch.inf)
        nearest = torch.where(torch.isfinite(reach).any(0), reach.argmin(0), HIDDEN)
        may_touch = state.model.outer & state.finite_people[:, None]
        touches = (probability >= _THRESHOLD) & may_touch
        kind = torch.where(touches, torch.where(own.kind >= 0, own.kind, nearest), -1)
        several = (photos > 0)[:, None]
        return Touch(
            torch.where(several, kind, own.kind), torch.where(several, probability, own.probability)
        )


def require_default_engine(settings: EngineSettings) -> None:
    """Check that settings are of preset "default".

    Raises:
        ConfigError: they are of another preset.
    """
    if (
        type(settings.joint) is not DefaultJointStage
        or type(settings.placement) is not PlacementStageMethod
    ):
        raise ConfigError(
            "physic scene solves with engine.preset 'default': leave engine.preset out"
        )


def with_other_views(settings: EngineSettings, views: OtherViews) -> EngineSettings:
    """Return settings of preset "default" with other photos, and with the errors of their
    keypoints.
    """
    assert isinstance(settings.joint, DefaultJointStage)

    def field_values(part: object) -> dict[str, object]:
        return {field.name: getattr(part, field.name) for field in fields(part)}  # type: ignore[arg-type]

    keypoints = replace(settings.joint.reprojection, sigma=_KEYPOINT, outlier_sigmas=_OUTLIER)
    frozen = (*settings.joint.frozen, "scale") if views.scale_is_known else settings.joint.frozen
    joint = replace(settings.joint, reprojection=keypoints, frozen=frozen)
    placement = ViewsPlacement(**field_values(settings.placement), views=views)  # type: ignore[arg-type]
    scene = ViewsScene(**field_values(settings.scene), views=views)  # type: ignore[arg-type]
    contact = ViewsContact(**field_values(settings.contact), views=views)  # type: ignore[arg-type]
    return replace(settings, scene=scene, placement=placement, joint=joint, contact=contact)
