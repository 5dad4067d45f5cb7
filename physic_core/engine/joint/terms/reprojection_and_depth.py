"""Terms on the picture: keypoints (L_j2d), those of other cameras, and the depth of visible
vertices (L_d).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.snapshot import sample_mask_neighbours
from physic_core.engine.joint.term import (
    PosedBodies,
    RobustLoss,
    RobustSum,
    Snapshot,
    SurfaceResidual,
    SurfaceSlopes,
    SurfaceTerm,
    Term,
    VertexDistances,
)
from physic_core.engine.joint.terms.reprojection_settings import ReprojectionSettings
from physic_core.engine.joint.terms.scene_contact import OUTLIER_SIGMAS
from physic_core.engine.joint.variables import Variables
from physic_core.engine.limbs import keypoints_of_observed_limbs
from physic_core.engine.state import State
from physic_core.errors import PhysicError
from physic_core.geometry.camera import project
from physic_core.geometry.robust import robust_loss
from physic_core.geometry.visibility import inside_image
from physic_core.types.bounds import NotNegative
from physic_core.types.skeletons import SEEN_CONFIDENCE

INVISIBLE_WEIGHT = 0.4
"""Weight of keypoints on invisible limbs, which detectors extrapolate from the visible ones."""

_GIVEN_SHARE = 0.25
"""Weight of keypoints of people whose body the user gives.

The detector's joints are 25 to 60 mm off per axis (12 joints of four people with true ones), twice
to three times the sigma of the term, which is small so that they outweigh a pose estimated from
them. Bodies of other programs are not worse.
"""

MIN_DEPTH_M = 0.01
"""Smallest depth of a vertex in the logarithm, metres; smaller depths are clamped."""


class ReprojectionTerm(Term):
    """Reprojection term L_j2d (Eq. 2) of all keypoints: ``sum_j w_j rho(|(pi(J_j) - J^_j) /
    unit|^2)``.

    Args:
        weight: of the term; 0 removes it.
        unit: (B, 1 or 2) px, the error of size 1: a share of the person, or the image's width and
            height.
        rho: robust loss.
    """

    def __init__(self, sampling: Sampling, weight: float, unit: Tensor, rho: RobustLoss) -> None:
        self._sampling = sampling
        self._unit = unit
        self._rho = rho
        self._observed, _ = finite_keypoints(sampling.state)
        self.weights = {"reprojection": sampling.keypoint_weights}
        self._weight = weight * sampling.keypoint_weights if weight else None

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "reprojection"."""
        if self._weight is None:
            return {}
        projected = project(bodies.keypoints, self._sampling.state.K)
        error = (projected - self._observed) / self._unit[:, None]
        return {"reprojection": (self._weight * self._rho(error.square().sum(-1))).sum(-1)}


def robust_reprojection(settings: ReprojectionSettings, sampling: Sampling) -> ReprojectionTerm:
    """Return the term with errors in shares of the person's stature and a Cauchy loss."""
    unit = sampling.person_px[:, None] * settings.sigma
    rho = partial(robust_loss, "cauchy", c=settings.outlier_sigmas)
    return ReprojectionTerm(sampling, settings.weight, unit, rho)


def finite_keypoints(state: State) -> tuple[Tensor, Tensor]:
    """Return keypoints (B, J, 2) px and confidence (B, J); both are set to 0 if either is not
    finite.
    """
    points = state.keypoints
    confidence = state.keypoint_confidence
    finite = torch.isfinite(points).all(-1) & torch.isfinite(confidence)
    points = torch.where(finite[..., None], points, 0.0)
    return points, torch.where(finite, confidence, 0.0)


def keypoint_weights(state: State) -> Tensor:
    """Return the weights (B, J) of keypoints by confidence, with less weight on limbs that are not
    visible in any photo and on people whose body the user gives, and none on ears where the
    direction of the face is observed.
    """
    points, confidence = finite_keypoints(state)
    observed = keypoints_of_observed_limbs(state.skeleton, state.observed_in_any_photo)
    weight = torch.where(confidence < SEEN_CONFIDENCE, 0.0, confidence)
    weight = torch.where(observed, weight, INVISIBLE_WEIGHT * confidence)
    if state.head_sigma is not None:
        # of which detectors invent what the head hides
        ears = [j for j, name in enumerate(state.skeleton.names) if name.endswith("ear_surface")]
        weight[:, ears] *= state.head_sigma.isnan()[:, None]
    weight = torch.where(state.is_given[:, None], _GIVEN_SHARE * weight, weight)
    return weights_inside_image(state, points, weight)


def weights_inside_image(state: State, points: Tensor, weight: Tensor) -> Tensor:
    """Return the weights (B, J), multiplied by those of the skeleton, and 0 for keypoints outside
    the image.
    """
    weight = weight * inside_image(points, *state.masks.shape[-2:])
    skeleton = state.skeleton
    return weight * weight.new_tensor([skeleton.weights.get(name, 1.0) for name in skeleton.names])


@dataclass(frozen=True)
class DepthSettings:
    """Settings of the depth term: depth of visible vertices against the depth map."""

    weight: NotNegative = 15.0
    """Lambda_d of Eq. 5; 0 removes the term."""
    offset_sigma: NotNegative = 0.2
    """Expected log(depth offset) between person and scene, for people whose feet stand on a known
    floor; 0 fixes their depth to the scene.
    """
    offset_alone_sigma: NotNegative = 0.03
    """Expected log(depth offset) of all other people."""


_DEPTH_SIGMA = 0.03  # expected error of the logarithm of depth
# With a free depth offset only the relief of a person counts, which networks estimate less reliably
# than the distance.
_RELIEF_SHARE = 2.0 / 15.0
# Distance from the silhouette, statures in px: nearer, the depth often belongs to the background.
_EDGE_SHARE = 0.005


class DepthTerm(SurfaceTerm):
    """Depth term: Eq. 4 with log depth, between each visible vertex and the depth map at its
    projection.

    ``mean_v rho((log z_v - log(s d_v) - o)^2 / sigma^2)``, with scale s of the scene and depth
    offset o of the person. The mean does not depend on the resolution.

    Args:
        state: free parameters; people with a free offset have a smaller weight.

    Raises:
        PhysicError: the photo has no depth map.
    """

    name = "depth"

    def __init__(self, settings: DepthSettings, sampling: Sampling, variables: Variables) -> None:
        if settings.weight and sampling.state.photo_depth is None:
            raise PhysicError(
                "the depth term compares pixels, but the depth of the photo is missing: give it, "
                "or set engine.joint.depth.weight = 0"
            )
        self.weight = settings.weight
        self._sampling = sampling
        self._per_person = torch.where(
            variables.offset_free, settings.weight * _RELIEF_SHARE, settings.weight
        )
        self.log_map_depth: Tensor

    def refresh(self, snapshot: Snapshot) -> RobustSum:
        """Select visible vertices away from the mask's border, and weigh them by their area in
        pixels.
        """
        sampling = self._sampling
        visibility = snapshot.visibility
        assert sampling.log_depth is not None
        self.log_map_depth, known = _sample_log_depth(sampling.log_depth, visibility.uv)
        edge_px = sampling.person_px * _EDGE_SHARE
        well_inside = sample_mask_neighbours(visibility.uv, sampling.state.masks, edge_px).all(0)
        is_visible = visibility.unobstructed & known & well_inside & visibility.eligible
        # A slanted surface covers fewer pixels.
        rays = torch.nn.functional.normalize(snapshot.vertices, dim=-1)
        slope = -(visibility.normals * rays).sum(-1)
        weight = torch.where(is_visible, sampling.area * slope, 0.0)
        share = weight / weight.sum(1, keepdim=True).clamp(min=1e-9)
        return RobustSum(
            "cauchy",
            OUTLIER_SIGMAS,
            _DEPTH_SIGMA,
            self._per_person.to(share.dtype)[:, None] * share,
        )

    def residual(self, at: VertexDistances) -> SurfaceResidual:
        """Return the differences of log depth."""
        away = at.log_depth - self.log_map_depth - at.log_scale
        return SurfaceResidual(away, SurfaceSlopes(log_depth=1.0))


def depth_offset_sigmas(settings: DepthSettings, sampling: Sampling) -> Tensor:
    """Return the expected size of each person's log depth offset to the scene: (B,), 0 for a fixed
    offset.
    """
    state = sampling.state
    feet_visible = sampling.feet_visible
    sigma_alone = torch.full_like(state.transl[:, 2], settings.offset_alone_sigma)
    if sampling.surroundings.floor is None:
        return sigma_alone
    on_floor = feet_visible.any(1).to(sigma_alone)
    if state.limb_touch_probability is not None:
        on_floor = on_floor * (
            1 - (1 - state.limb_touch_probability[:, :2].to(sigma_alone)).prod(1)
        )
    if state.rest_probability is not None:
        on_floor = torch.where(
            torch.isfinite(state.rest_probability), state.rest_probability.to(sigma_alone), on_floor
        )
    if state.distance_sigma is not None:  # the user states where they are
        on_floor = torch.where(torch.isfinite(state.distance_sigma), 1.0, on_floor)
    return torch.lerp(sigma_alone, torch.full_like(sigma_alone, settings.offset_sigma), on_floor)


def _sample_log_depth(log_depth: Tensor, uv: Tensor) -> tuple[Tensor, Tensor]:
    """Return the map at the nearest pixel, 0 where unknown, and whether it is known: (B, n)
    each.
    """
    height, width = log_depth.shape
    inside = inside_image(uv, height, width)
    at = torch.where(inside[..., None], uv, 0.0).round().long()
    value = log_depth[at[..., 1], at[..., 0]].to(uv.dtype)
    is_known = inside & torch.isfinite(value)
    return torch.where(is_known, value, 0.0), is_known


class ViewsTerm(Term):
    """Sum of the reprojection terms of all other cameras, with the weight and loss of the photo's
    term.
    """

    def __init__(self, settings: ReprojectionSettings, sampling: Sampling) -> None:
        self._terms = [
            (view, robust_reprojection(settings, own))
            for view, own in zip(sampling.state.views, sampling.views, strict=True)
        ]

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "views"."""
        scale = bodies.estimate.log_scale.exp()
        residuals: list[Tensor] = []
        for view, term in self._terms:
            residuals += term(
                replace(bodies, keypoints=view.to_camera(bodies.keypoints, scale))
            ).values()
        return {"views": torch.stack(residuals).sum(0)} if residuals else {}
