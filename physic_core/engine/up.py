"""Which way is up, and how surely: witnesses with stated errors, whether or not a floor is seen.

A floor is one witness of several. Ground slopes outdoors, so that its normal is not quite up.
OpenCV camera frame, angles in degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.geometry.floor import PlaneFit
from physic_core.types import Pointmap, SurfaceLabels
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types import FloatArray

AXIS_SIGMA_DEG = 13.0
"""Standard deviation between up and the camera's own up axis, of photos that show no floor."""

DISAGREE = 2.5
"""Joint standard deviations from which on two witnesses contradict each other."""

REPORTED_DEG = 15.0
"""Angle from which on two witnesses contradict each other whatever their errors, if both are surer
than the camera's axis.
"""

GIMBAL_SIGMA_DEG = 2.0
"""Standard deviation of up by the pitch that a drone states. Assumed: gimbals hold a hundredth of a
degree, but their horizon drifts by one or two, which pilots correct by hand.
"""

_BODY_SIGMA_DEG = 6.0  # of a trunk that stands, sideways from the vertical
_BODIES = 3.0  # independent observations that all bodies are worth
_WRONG = 0.05  # share of stated ups that are far off
_WRONG_RANGE_DEG = 90.0  # of their angles to bodies

_SLOPE_OF_ROOMS_DEG = 0.5  # sigma of a floor's normal from up: floors of rooms are level
_SLOPE_OUTDOORS_DEG = 4.0  # the same of streets and lawns, which slope
_LEAST_SURE_DEG = 7.0  # a less sure witness turns no floor: floors of rooms are 2 degrees off (rms)


@dataclass(frozen=True)
class Up(ShortRepr):
    """One answer to which way is up.

    Attributes:
        direction: (3,) unit, float64.
        sigma: standard deviation of its angle to the truth in each of two directions.
        source: what tells it, in words.
    """

    direction: Tensor
    sigma: float
    source: str


def up_of_camera_axis() -> Up:
    """Return the camera's own up axis."""
    direction = torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)
    return Up(direction, AXIS_SIGMA_DEG, "the camera's axis")


def stored_up(pointmap: Pointmap) -> Up | None:
    """Return what a point map says of up; None if it says nothing."""
    if pointmap.up is None or pointmap.up_sigma is None:
        return None
    direction = torch.from_numpy(pointmap.up).double()
    return Up(direction, float(pointmap.up_sigma), pointmap.up_source)


def with_up_of_file(pointmap: Pointmap, stated: FloatArray | None) -> tuple[Pointmap, str]:
    """Return a point map whose up is also told by that of the photo's file, (3,) or None, and a
    warning where they contradict each other, or "".
    """
    if stated is None:
        return pointmap, ""
    gimbal = Up(torch.from_numpy(stated), GIMBAL_SIGMA_DEG, "the gimbal")
    stored = stored_up(pointmap)
    fused = gimbal if stored is None else fused_up([gimbal, stored])
    warning = ""
    if stored is not None and difference_sigmas(gimbal, stored) > DISAGREE:
        difference_deg = angle_deg(gimbal.direction, stored.direction)
        warning = (
            f"the pitch of the drone's gimbal contradicts the {stored.source} of the photo by "
            f"{difference_deg:.0f} degrees, and up lies between them: leans and the turn of "
            f"exports may be wrong. If the photo was cropped or turned, give the original"
        )
    with_up = replace(
        pointmap, up=fused.direction.numpy(), up_sigma=fused.sigma, up_source=fused.source
    )
    return with_up, warning


def up_checked_by_people(up: Up | None, bodies: Tensor) -> tuple[Up | None, tuple[str, ...]]:
    """Return up with the error that people who stand leave it, and a warning if they contradict it.

    Args:
        up: without a floor; None if nothing tells it.
        bodies: (M, 3) unit normals of the planes through the camera and each of M people who
            stand: gravity lies in these planes.
    """
    if up is None or not len(bodies):
        return up, ()
    lean_deg = torch.rad2deg(torch.asin((bodies.double() @ up.direction).clamp(-1, 1)))
    sigma = math.hypot(up.sigma, _BODY_SIGMA_DEG)
    density = torch.exp(-0.5 * (lean_deg / sigma).square()) / (sigma * math.sqrt(2 * math.pi))
    nats = torch.log((density * _WRONG_RANGE_DEG).clamp(min=1e-9)).mean() * min(
        len(lean_deg), _BODIES
    )
    right_probability = 1 / (1 + _WRONG / (1 - _WRONG) * math.exp(-float(nats)))
    median_lean = float(lean_deg.abs().median())
    widened = replace(
        up, sigma=math.hypot(up.sigma, math.sqrt(1 - right_probability) * median_lean)
    )
    if right_probability > 0.5:
        return widened, ()
    return widened, (
        f"against the {up.source} of the photo, the people who stand lean sideways by "
        f"{median_lean:.0f} degrees. Up follows the people: if they do lean, leans and the turn of "
        f"exports are wrong",
    )


def slope_sigma(labels: SurfaceLabels | None) -> float:
    """Return the standard deviation of the floor's normal from up by the labels of a photo."""
    if labels is None:
        return _SLOPE_OUTDOORS_DEG
    outdoors, indoors = labels.outdoor_and_indoor_shares
    share = (outdoors + 1e-3) / (outdoors + indoors + 1e-3)
    return _SLOPE_OF_ROOMS_DEG + share * (_SLOPE_OUTDOORS_DEG - _SLOPE_OF_ROOMS_DEG)


def surest_up(floor: PlaneFit | None, up: Up | None, slope: float) -> Up:
    """Return the surest of a floor after :func:`level_plane`, up without it, and the camera.

    An up that is too unsure to turn a floor replaces it only where the camera's axis would: steep
    views look level. The error contains the contradiction of floor and up, whichever wins.
    """
    other = _up_or_axis(up)
    if floor is None:
        return other
    sure = other.sigma < _LEAST_SURE_DEG
    sigma = math.degrees(floor.pitch_sigma if sure else floor.plane_sigma)
    floor_up = Up(floor.normal.double(), math.hypot(sigma, slope), "the floor")
    limit = other.sigma if sure else AXIS_SIGMA_DEG
    if floor_up.sigma < limit:
        return floor_up if up is None else _with_contradiction(floor_up, up)
    sloped = Up(
        floor_up.direction, math.hypot(math.degrees(floor.plane_sigma), slope), floor_up.source
    )
    return _with_contradiction(other, sloped) if sure else other


def _with_contradiction(up: Up, loser: Up) -> Up:
    """Return up whose error contains its angle to a witness that contradicts it, by the share of
    that one in their precisions.
    """
    if not contradict(up, loser):
        return up
    share = up.sigma / math.hypot(up.sigma, loser.sigma)
    off = angle_deg(up.direction, loser.direction)
    return replace(up, sigma=math.hypot(up.sigma, share * off))


def _up_or_axis(up: Up | None) -> Up:
    """Return up, or the camera's axis if that is surer, beside half of the angle between them."""
    axis = up_of_camera_axis()
    if up is None:
        return axis
    off = angle_deg(up.direction, axis.direction)
    return up if up.sigma < math.hypot(axis.sigma, off / 2) else axis


def fused_up(witnesses: Sequence[Up]) -> Up:
    """Return the mean of witnesses by their precisions.

    The farther a witness is from the surest one, the less it counts: one of them may be wrong.
    """
    first = min(witnesses, key=lambda one: one.sigma)
    precision = torch.tensor(
        [1 / one.sigma**2 / (1 + difference_sigmas(first, one) ** 2) for one in witnesses]
    )
    total = precision.double() @ torch.stack([one.direction for one in witnesses])
    direction = torch.nn.functional.normalize(total, dim=0)
    return Up(direction, 1 / math.sqrt(float(precision.sum())), first.source)


def difference_sigmas(first: Up, second: Up) -> float:
    """Return how far two witnesses differ, in joint standard deviations."""
    joint = math.hypot(first.sigma, second.sigma)
    return angle_deg(first.direction, second.direction) / joint


def contradict(first: Up, second: Up) -> bool:
    """Return whether two witnesses contradict each other."""
    if difference_sigmas(first, second) > DISAGREE:
        return True
    off = angle_deg(first.direction, second.direction)
    return off >= REPORTED_DEG and max(first.sigma, second.sigma) < AXIS_SIGMA_DEG


# Least cosine between a ray and the normal: a plane is not turned about a point at the horizon.
_GRAZING = 0.02


def level_plane(plane: PlaneFit, up: Up | None, slope: float, ray: Tensor) -> PlaneFit:
    """Return a floor turned towards up about its point on a ray, and its error after that.

    Args:
        plane: by its pixels.
        up: without the floor; None leaves the plane as it is.
        slope: of the floor.
        ray: (3,) to the part of the floor that counts, such as the feet.

    Returns:
        The floor; where it contradicts up it is not turned, and its error is the angle between
        them. Where up is too unsure it is as it was.
    """
    if up is None:
        return plane
    level = replace(up, sigma=math.hypot(up.sigma, slope))
    floor_up = Up(plane.normal.double(), math.degrees(plane.plane_sigma), "the floor")
    if difference_sigmas(floor_up, level) > DISAGREE:
        sigma_deg = math.hypot(floor_up.sigma, angle_deg(floor_up.direction, up.direction))
        return replace(plane, pitch_sigma=math.radians(sigma_deg))
    if up.sigma >= _LEAST_SURE_DEG:
        return plane
    fused = fused_up([floor_up, level])
    sigma = math.radians(fused.sigma)
    normal = fused.direction.to(plane.normal)
    direction = ray.to(plane.normal)
    steep, steeper = (-float(direction @ one) for one in (plane.normal, normal))
    if min(steep, steeper) <= _GRAZING * float(torch.linalg.vector_norm(direction)):
        return plane
    offset = plane.offset * steeper / steep
    return replace(plane, normal=normal, offset=offset, pitch_sigma=sigma)


def slope_warnings(floor: PlaneFit | None, up: Up | None, slope: float) -> tuple[str, ...]:
    """Return a warning if a floor contradicts up; nothing if it does not."""
    if floor is None or floor.beneath or up is None:
        return ()
    floor_up = Up(floor.normal.double(), math.degrees(floor.plane_sigma), "the floor")
    if not contradict(floor_up, replace(up, sigma=math.hypot(up.sigma, slope))):
        return ()
    off = angle_deg(floor.normal, up.direction)
    return (
        f"the floor slopes by {off:.0f} degrees against the {up.source} of the photo. Heights and "
        f"the lean of people follow the floor, and up follows {surest_up(floor, up, slope).source}"
        f": they are wrong unless the ground slopes. Compare the floor's line with the photo, from "
        f"the side in preview.png",
    )


def angle_deg(first: Tensor, second: Tensor) -> float:
    """Return the angle between two vectors (3,)."""
    cosine = torch.nn.functional.cosine_similarity(first.double(), second.double(), dim=0)
    return math.degrees(math.acos(min(1.0, max(-1.0, float(cosine)))))
