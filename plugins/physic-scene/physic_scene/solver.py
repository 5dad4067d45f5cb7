"""The CameraSolver of this package: cameras from the people of the photos."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from physic_core.body import load_body
from physic_core.interfaces import CameraSolver, Options
from physic_scene.bundle import BundleSettings
from physic_scene.cameras import solve_cameras
from physic_scene.matching import MatchingSettings
from physic_scene.observations import observe
from physic_scene.selection import PhotoWithPeople, select_photos
from physic_scene.settings import FitLimits, MomentSettings

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import MomentView, SolvedCameras


class PeopleCamerasOptions(Options):
    """Settings of PeopleCameras; docs/scene.md explains its steps."""

    matching: MatchingSettings = Field(MatchingSettings(), description="who is who")
    bundle: BundleSettings = Field(BundleSettings(), description="bundle adjustment of cameras and people")
    fit: FitLimits = Field(FitLimits(), description="limits of what fits one moment")

    def settings(self) -> MomentSettings:
        """Return the settings of all steps."""
        return MomentSettings(**{name: getattr(self, name) for name in type(self).model_fields})


def solver_options(settings: MomentSettings) -> dict[str, object]:
    """Return the options of PeopleCameras that are part of the settings of a scene."""
    return {name: getattr(settings, name) for name in PeopleCamerasOptions.model_fields}


class PeopleCameras(CameraSolver):
    """Matches people, and solves cameras by a bundle adjustment of their keypoints and bodies."""

    Options: ClassVar[type[Options]] = PeopleCamerasOptions
    options: PeopleCamerasOptions
    cacheable: ClassVar[bool] = False  # it takes seconds, and its input is large

    _model: BodyModel | None = None

    def load(self, device: str = "cpu") -> None:
        """Load the body model on which keypoints are found; it stays on the CPU."""
        import torch

        if self._model is None:
            self._model = load_body("embedded").to(dtype=torch.float64)

    def close(self) -> None:
        """Release the body model."""
        self._model = None

    def infer(self, photos: tuple[MomentView, ...]) -> SolvedCameras:
        """Solve the cameras of V photos in one metric frame."""
        self.load()
        assert self._model is not None
        settings = self.options.settings()
        seen = [PhotoWithPeople(i, view, observe(view, self._model)) for i, view in enumerate(photos)]
        return solve_cameras(select_photos(seen, settings), len(photos), settings)
