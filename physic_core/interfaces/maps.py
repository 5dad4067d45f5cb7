"""Interfaces MetricDepth, RelativePointmap and Inpainter: depth in meters, points up to a scale,
and the background.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, get_args

from physic_core.interfaces.backend import Backend, Request
from physic_core.interfaces.checks import (
    DEPTH_M,
    RELATIVE_DEPTH,
    check_array,
    check_camera,
    check_fields,
    check_finite,
    check_log_sigma,
    check_median,
    check_notes,
    is_finite,
)
from physic_core.types import AffineAmbiguity, DepthMap, Hints, Pointmap

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array


@dataclass(frozen=True)
class MetricDepthRequest(Request[DepthMap]):
    """Input of a MetricDepth: the inpainted photo and hints.

    ``people``, ``keypoints`` and ``bodies`` of the hints are limited to people with a finite body.
    """

    hints: Hints = field(default_factory=Hints)


class MetricDepth(Backend):
    """Estimates a metric depth map of the inpainted photo (paper: DepthPro).

    The scale of the depth is one vote on the scale of the scene, beside the people and everything
    else of known size. Its sigma is ``scale_sigma``, or 0.1 without one. The depth is then
    multiplied to the scale of the vote. A backend with "scale" in ``reads`` gets the vote of all
    others in ``hints.scale``, and its depth is not rescaled. A backend that needs people, and gets
    none, raises NoPersonError: the depth is then that of the scene.

    A backend that measures or reads depth sets ``sees = "photo"``: it is called once, for the photo
    with its people and without hints. If it states an error of at most .05, scene and people have
    the shape of its depth where it is known.
    """

    interface = "metric_depth"
    api = 1
    Request = MetricDepthRequest
    Result = DepthMap
    sees = "inpainted"
    hints = (
        "intrinsics",
        "people",
        "keypoints",
        "hole",
        "scene",
        "original",
        "floor",
        "scale",
        "bodies",
    )

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Estimate the depth of each pixel along z, in meters; NaN where unknown.

        A network for a fixed focal length f sees a photo of another one, fx, at a wrong distance:
        multiply by fx / f.

        Example: a wall straight ahead at 3 m has the depth 3.0 in all pixels, in the corners too.
        """

    @classmethod
    def check(cls, result: DepthMap, request: MetricDepthRequest) -> Iterator[str]:
        """Check depth (H, W), within limits or NaN, with at least one known pixel; camera,
        scale_sigma and notes.
        """
        height, width = request.image.shape[:2]
        wrong = check_fields(result, H=height, W=width)
        yield from wrong
        if not wrong:
            finite = result.depth[is_finite(result.depth)]
            if not len(finite):
                yield "depth is NaN or infinite everywhere"
            elif (finite <= 0).any():
                yield f"depth must be > 0 m or NaN, the smallest is {float(finite.min()):g}"
            else:
                yield from check_median("depth", finite, DEPTH_M, "m")
        if result.scale_sigma is not None:
            yield from check_log_sigma("scale_sigma", result.scale_sigma)
        yield from check_camera(result.intrinsics, height, width)
        yield from check_notes(result.notes)


@dataclass(frozen=True)
class RelativePointmapRequest(Request[Pointmap]):
    """Input of a RelativePointmap: the inpainted or the original photo, and hints.

    ``hole`` and ``photo`` of the hints are None for the original photo.
    """

    hints: Hints = field(default_factory=Hints)


class RelativePointmap(Backend):
    """Estimates a point map up to a scale, or up to a scale and an offset (paper: MoGe).

    Called for the inpainted photo (``hints.hole`` is the inpainted region, ``hints.photo`` the
    original photo), then for the original photo (both are None, ``hints.scene`` is the first
    result). Inpainted pixels are invented: cues of the camera, such as straight lines, are better
    taken from ``hints.photo`` outside the hole.
    """

    interface = "relative_pointmap"
    api = 1
    Request = RelativePointmapRequest
    Result = Pointmap
    sees = "inpainted"
    hints = ("intrinsics", "people", "keypoints", "hole", "photo")

    @abstractmethod
    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Estimate a point map of an image; ``hints.intrinsics`` are used if given.

        Example: with cx = 159.5, fx = 300 and z = 2, the point of column 159 has x = (159 - 159.5)
        / 300 * 2.
        """

    @classmethod
    def check(cls, result: Pointmap, request: RelativePointmapRequest) -> Iterator[str]:
        """Check points (H, W, 3), within limits and in front of the camera where valid; and the
        rest.
        """
        height, width = request.image.shape[:2]
        wrong = check_fields(result, H=height, W=width)
        yield from wrong
        if not wrong:
            yield from _check_points(result.points, result.valid)
            yield from _check_up(result)
        if result.unknown not in get_args(AffineAmbiguity):
            yield (
                f"unknown must be one of {', '.join(get_args(AffineAmbiguity))}, got "
                f"{result.unknown!r}"
            )
        if result.shift_sigma is not None and not 0 <= result.shift_sigma < math.inf:
            yield f"shift_sigma must be finite and at least 0, or None, got {result.shift_sigma!r}"
        if result.people_farther is not None and not _is_mean_and_sigma(result.people_farther):
            yield (
                f"people_farther must be a finite mean and a sigma > 0, or None, got "
                f"{result.people_farther!r}"
            )
        yield from check_camera(result.intrinsics, height, width)
        yield from check_notes(result.notes)
        yield from check_notes(result.warnings, "warnings")


_UNIT = 1e-3  # of the length of a unit vector
_MOST_UP_DEG = 90.0  # beyond, nothing is known of up


def _check_up(result: Pointmap) -> Iterator[str]:
    """Check that up is a unit vector with a sigma in degrees, or that both are None."""
    import numpy as np

    if result.up is None:
        if result.up_sigma is not None:
            yield f"up_sigma is given without up: give both or neither, got {result.up_sigma!r}"
        return
    if not abs(float(np.linalg.norm(result.up)) - 1) < _UNIT:
        yield f"up must be a vector (3,) of length 1, got {result.up.tolist()}"
    if result.up_sigma is None or not 0 < result.up_sigma < _MOST_UP_DEG:
        yield f"up_sigma must be degrees, > 0 and < {_MOST_UP_DEG:g}, got {result.up_sigma!r}"


def _is_mean_and_sigma(given: tuple[float, float]) -> bool:
    try:
        mean, sigma = given
        return math.isfinite(mean) and 0 < sigma < math.inf
    except (TypeError, ValueError):
        return False


_REVERSED = -0.5  # correlation of the points' directions with the columns or rows of their pixels
_CORRELATED = 20_000  # about the number of pixels that the correlation is taken of


def _check_points(whole: FloatArray, valid: BoolArray) -> Iterator[str]:
    """Check the valid ones of points (H, W, 3)."""
    import numpy as np

    points = whole[valid]
    if not len(points):
        yield "no pixel is valid"
        return
    not_finite = list(check_finite("points", points))
    if not_finite:
        yield from not_finite
    elif (points[:, 2] <= 0).any():
        share = float((points[:, 2] <= 0).mean())
        yield f"z must be > 0 where valid (z forward), {share:.0%} of the valid points lie behind"
    else:
        yield from check_median("z", points[:, 2], RELATIVE_DEPTH)
        some = np.flatnonzero(valid)[:: -(-len(points) // _CORRELATED)]
        rows, columns = np.unravel_index(some, valid.shape)
        points = whole[rows, columns].astype(np.float64)
        places = zip(("x", "y"), ("columns", "rows"), (columns, rows), strict=True)
        for axis, (name, what, pixels) in enumerate(places):
            directions = points[:, axis] / points[:, 2]
            apart = [v - v.mean() for v in (pixels, directions)]
            size = float(np.linalg.norm(apart[0]) * np.linalg.norm(apart[1]))
            if size and float(apart[0] @ apart[1]) < _REVERSED * size:
                yield (
                    f"{name} must grow with the {what} of the image (x right, y down, z forward), "
                    f"and it falls: is it mirrored, or of an OpenGL camera?"
                )


@dataclass(frozen=True)
class InpainterRequest(Request["UInt8Array"]):
    """Input of an Inpainter: the photo, and a mask (H, W) bool, True = remove."""

    mask: BoolArray


class Inpainter(Backend):
    """Replaces the masked pixels of a photo by background (paper: OmniEraser)."""

    interface = "inpainter"
    api = 1
    Request = InpainterRequest
    Result = object

    @abstractmethod
    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Replace the pixels where the mask is True; the other pixels and the size stay unchanged.

        The mask is wider than the people by a margin: fill all of it, without blending at its
        border.

        Example: ``np.where(mask[..., None], filled, image)``, where ``filled`` is the output of a
        network at the size of the image.
        """

    @classmethod
    def check(cls, result: UInt8Array, request: InpainterRequest) -> Iterator[str]:
        """Check that the result is an image of the same size as the input."""
        yield from check_array("image", result, (*request.image.shape[:2], 3), "uint8")
