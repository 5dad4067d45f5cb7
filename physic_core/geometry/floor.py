"""Planes fitted to a point map, any of which may be the floor. OpenCV camera frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from torch import Tensor

from physic_core.geometry.inverse_depth import (
    FEWEST_SAMPLES,
    InverseDepthMap,
    average_blocks,
    fit_plane,
    inverse_depth_map,
    lower_inlier_shares,
    plane_inlier_shares,
    refit,
)
from physic_core.types import Plane

FEET_WINDOW = 0.08
"""Half side of the pixel window around each foot, as a share of the long image side."""

MASK_SLACK = 1.5
"""Factor on the tolerance of pixels labelled or masked as floor: depth networks bend floors."""

PITCH_SIGMA = math.radians(1.5)
"""Standard deviation of the camera's pitch over a floor, radians, if the camera is known: .3 to 2.2
degrees.
"""

FOCAL_PITCH_DEG = 23.0
"""Error of that pitch by the logarithmic error of the focal length: 6 degrees of a default one."""

FloorReason = Literal["found", "no_pixels", "no_consensus", "switched_off"]
"""Result of a search: "found"; "no_pixels": too few pixels; "no_consensus": no plane is more likely
than none; "switched_off" by the settings.
"""

FloorSource = Literal[
    "floor mask", "labels", "lower image", "level surfaces", "soles", "people who lie"
]
"""Pixels that a plane was fitted to: of the floor mask, with the label of a floor, of the lower
part of the image, of its horizontal surfaces, at the soles of people, or around people who lie.
"""


@dataclass(frozen=True)
class PlaneFit:
    """A plane fitted to a point map.

    Attributes:
        normal: (3,) unit, up, on the camera's side.
        offset: height of the camera over the plane > 0, in the unit of the points.
        inliers: (H, W) bool, pixels on the plane.
        inlier_share: share of the candidate pixels on the plane.
        below_share: share of the lower part's pixels below the plane.
        source: image region of the candidates.
        reanchored: factor on 1 / Z that moved the plane to the depth at the feet; 1 if not moved.
        pitch_sigma: standard deviation of the camera's pitch over the plane, radians.
        plane_sigma: the same by the pixels of the plane alone.
        height_sigma: standard deviation of log(offset) by bodies whose place the user states;
            infinite if none stands on it.
    """

    normal: Tensor
    offset: float
    inliers: Tensor
    inlier_share: float
    below_share: float
    source: FloorSource
    reanchored: float = 1.0
    pitch_sigma: float = PITCH_SIGMA
    plane_sigma: float = PITCH_SIGMA
    height_sigma: float = math.inf

    @property
    def beneath(self) -> bool:
        """Whether people lie on the plane, and the camera looks down on them."""
        return self.source == "people who lie"

    @property
    def by_ray(self) -> Tensor:
        """Inverse depth (3,) of the plane by ray, float64: 1 / Z is its product with (x, y, 1)."""
        return -self.normal.double() / self.offset

    def height(self, points: Tensor) -> Tensor:
        """Return the signed height (...) of points (..., 3) over the plane, in their unit."""
        return points @ self.normal.to(points) + self.offset

    def moved(self, factor: float) -> PlaneFit:
        """Return the plane with its inverse depth times a factor; the normal stays."""
        return replace(self, offset=self.offset / factor, reanchored=self.reanchored * factor)

    def scaled(self, factor: float) -> PlaneFit:
        """Return the plane of points times a factor."""
        return replace(self, offset=self.offset * factor)

    def to_plane(self) -> Plane:
        """Return normal and offset as an array and a number."""
        return Plane(self.normal.numpy(), float(self.offset))


@dataclass(frozen=True)
class FloorSearch:
    """Result of a floor search.

    Attributes:
        plane: the floor, or None.
        reason: why the search ended.
        inlier_share: of the best plane, accepted or not.
        below_share: of the best plane, accepted or not.
        in_mask: whether the floor is where the segmenter sees one; None without a floor, or if it
            sees none.
    """

    plane: PlaneFit | None
    reason: FloorReason
    inlier_share: float = 0.0
    below_share: float = 0.0
    in_mask: bool | None = None


def plane_of_pixels(
    view: InverseDepthMap,
    mask: Tensor | None,
    up: Tensor | None,
    source: FloorSource,
    slack: float = 1.0,
) -> PlaneFit | None:
    """Fit a plane to the pixels of a mask (H, W), or to the lower part of the image without one;
    None if none fits.

    Args:
        view: the point map.
        mask: candidate pixels.
        up: (3,) unit; the plane is at most 15 degrees off. None allows any plane seen from above by
            an upright camera.
        source: name of the pixels.
        slack: factor on the tolerance.
    """
    samples = average_blocks(view, mask)
    if int(samples.candidate.sum()) < FEWEST_SAMPLES:
        return None
    tolerance = slack * view.tolerance
    plane = fit_plane(samples, tolerance, view.least_rise, up)
    if plane is None:
        return None
    shares = plane_inlier_shares(samples, plane, tolerance)
    return plane_as_fit(view, plane, shares, source, slack)


def plane_as_fit(
    view: InverseDepthMap,
    plane: Tensor,
    shares: tuple[float, float],
    source: FloorSource,
    slack: float = 1.0,
) -> PlaneFit:
    """Return a plane (3,) in inverse depth as normal and offset, with its pixels."""
    tolerance = slack * view.tolerance
    expected = view.rays @ plane.to(view.rays)
    length = float(torch.linalg.vector_norm(plane))
    inliers = (
        view.valid & ((view.inverse - expected).abs() < tolerance) & (expected > 2 * tolerance)
    )
    return PlaneFit(-(plane / length).to(view.rays), 1 / length, inliers, *shares, source)


def plane_at_feet(view: InverseDepthMap, up: Tensor, feet_px: Tensor) -> PlaneFit | None:
    """Return the plane with a normal (3,) through the points at the feet (F, 2) px; None if none is
    in front of them.

    Its inverse depth is that of the median foot.
    """
    feet = feet_px.round().long()
    x, y = (feet[:, i].clamp(0, view.valid.shape[1 - i] - 1) for i in (0, 1))
    rays = view.rays[y, x].double()
    inverse = view.inverse[y, x].double()
    slope = -(rays @ up.to(rays))
    falls = view.valid[y, x] & (slope > 1e-3)
    if not falls.any():
        return None
    plane = -up.double() * (inverse[falls] / slope[falls]).quantile(0.5)
    return plane_as_fit(view, plane, lower_inlier_shares(view, plane), "soles")


_SAME_PLANE = 0.5  # least cosine between the normals of a plane in two point maps
_REFITTED_PIXELS = 60_000  # about the number of pixels that a known plane is fitted to again


def refit_floor(points: Tensor, valid: Tensor, search: FloorSearch) -> FloorSearch:
    """Fit the plane of an earlier search again, in a point map (H, W, 3), valid (H, W), of another
    unit, camera or offset of inverse depth.

    A plane that turns by more than 60 degrees is dropped: it is not the floor of the new map.
    """
    view = None if search.plane is None else inverse_depth_map(points, valid)
    if view is None or search.plane is None:
        return search
    on = (search.plane.inliers & view.valid).flatten().nonzero()[:, 0]
    if len(on) < FEWEST_SAMPLES:
        return FloorSearch(None, "no_pixels", search.inlier_share, search.below_share)
    some = on[:: -(-len(on) // _REFITTED_PIXELS)]
    rays, inverse = (each.flatten(0, 1)[some].double() for each in (view.rays, view.inverse))
    plane = refit(rays, inverse, MASK_SLACK * view.tolerance)
    shares = search.plane.inlier_share, search.plane.below_share
    fit = plane_as_fit(view, plane, shares, search.plane.source, MASK_SLACK)
    if float(fit.normal.double() @ search.plane.normal.to(fit.normal).double()) < _SAME_PLANE:
        return FloorSearch(None, "no_consensus", *shares)
    moved_fit = replace(
        fit.moved(search.plane.reanchored),
        pitch_sigma=search.plane.pitch_sigma,
        plane_sigma=search.plane.plane_sigma,
        height_sigma=search.plane.height_sigma,
    )
    return replace(search, plane=moved_fit)


def ray_to_floor(rays: Tensor, plane: PlaneFit, feet_px: Tensor) -> Tensor:
    """Return the mean ray (3,) to the feet, or to the pixels of a floor where no foot is seen.

    Args:
        rays: (H, W, 3) with z = 1, zero where unknown.
        plane: the floor.
        feet_px: (F, 2) px.
    """
    x, y = (feet_px.round().long()[:, i].clamp(0, rays.shape[1 - i] - 1) for i in (0, 1))
    at_feet = rays[y, x]
    at_feet = at_feet[at_feet[:, 2] > 0]
    return (at_feet if len(at_feet) else rays[plane.inliers]).double().mean(0)


_REANCHOR_RANGE = (0.5, 2.0)
_REANCHOR_BANDS = 4.0  # largest distance of floor pixels near feet from the plane, in tolerances


def move_to_feet(
    view: InverseDepthMap, plane: PlaneFit, mask: Tensor | None, feet_px: Tensor
) -> PlaneFit:
    """Scale the plane's inverse depth by the median factor at the feet; the normal stays.

    Args:
        view: the point map.
        plane: that is not moved.
        mask: (H, W) bool, pixels that it was fitted to, which are the ground near it; None for all
            pixels.
        feet_px: (F, 2) px.
    """
    ground = view.valid
    if mask is not None:
        ground = ground & mask & (view.error(plane.by_ray).abs() < _REANCHOR_BANDS * view.tolerance)
    factors = _depth_factors_at_feet(plane, view, ground, feet_px)
    factor = float(factors.quantile(0.5)) if len(factors) else 0.0
    if not _REANCHOR_RANGE[0] < factor < _REANCHOR_RANGE[1]:
        return plane
    return plane.moved(factor)


def _depth_factors_at_feet(
    plane: PlaneFit, view: InverseDepthMap, pixels: Tensor, feet_px: Tensor
) -> Tensor:
    """Return the ratio of measured inverse depth to the plane's at each foot in front of the
    plane's horizon.

    The measurement is the median over ``pixels`` (H, W) in a window around the foot.
    """
    reach = max(2, round(FEET_WINDOW * max(pixels.shape)))
    factors = []
    for u, v in feet_px.round().long().tolist():
        box = (
            slice(max(0, v - reach), max(0, v + reach + 1)),
            slice(max(0, u - reach), max(0, u + reach + 1)),
        )
        visible = pixels[box]
        expected = view.rays[box][visible] @ plane.by_ray.to(view.rays)
        near = expected > 2 * view.tolerance
        if near.any():
            factors.append(float((view.inverse[box][visible][near] / expected[near]).median()))
    return torch.tensor(factors, dtype=torch.float64)
