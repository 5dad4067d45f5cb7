"""Metric depth and point map of the user's, from files: a depth camera, a scanner, or another
program.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core import interfaces
from physic_core.errors import InputError
from physic_core.types import DepthMap, Pointmap
from physic_opencv.depth_files import (
    DEPTH_SUFFIXES,
    POINTMAP_SUFFIXES,
    check_suffix,
    read_depth,
    read_pointmap,
    resize_nearest,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hints, Intrinsics, UInt8Array


_LARGEST_RESIDUAL = 0.02  # of the long side: median distance of points from their pixels
_FARTHEST_MIDDLE = 0.1  # of the long side: the principal point of the points from the camera's


class DepthFileOptions(interfaces.Options):
    """Settings of the depth map from a file."""

    path: Path | None = Field(
        None,
        description="Required file: .npy (H, W), .npz with depth, 16-bit .png, "
        ".exr, .pfm, or the .heic photo of a phone that stores depth.",
    )
    scale: float = Field(
        1.0, ge=1e-6, le=1e6, description="Meters per unit of the file; 0.001 for millimeters."
    )
    invalid: float | None = Field(
        None,
        ge=-1e12,
        le=1e12,
        description="Value of unknown pixels in the file; 0, NaN and infinity are always unknown.",
    )
    sigma: float = Field(
        0.01, ge=1e-6, le=10, description="Standard deviation of the logarithm of the file's scale."
    )
    relative_sigma: float = Field(
        0.2,
        ge=1e-6,
        le=10,
        description="The same of a .heic file that calls its depth relative, as phones do that "
        "measure it with two "
        "cameras: no maker publishes a figure.",
    )


class PointmapFileOptions(interfaces.Options):
    """Settings of the point map from a file."""

    path: Path | None = Field(
        None,
        description="Required file: .npy (H, W, 3), or .npz with points and valid (H, W).",
    )
    scale: float = Field(
        1.0,
        ge=1e-6,
        le=1e6,
        description="Factor on the points; without effect where their scale is unknown.",
    )
    unknown: Literal["scale", "scale_shift", "inverse_scale_shift"] = Field(
        "scale",
        description="What the file leaves open: a factor, a factor and a shift of z, or the same "
        "of 1 / z.",
    )


class _ResultFromFile(interfaces.Backend):
    """Base class of backends whose result is in the file of the option ``path``."""

    suffixes: ClassVar[tuple[str, ...]]
    options: DepthFileOptions | PointmapFileOptions
    cacheable = False  # reading the file again costs less than the cache

    def missing(self) -> tuple[str, ...]:
        """Return a line if the file does not exist.

        Raises:
            InputError: no file of this suffix is read.
        """
        path = self.options.path
        if path is None:
            return (f"a file of this photo: set {self.interface}.options.path",)
        if path.is_file():
            check_suffix(path, self.suffixes)
            return ()
        return (
            f"{path}: there is no such file; set {self.interface}.options.path to the file of this "
            "photo",
        )

    def given_path(self) -> Path:
        """Return the path of the file.

        Raises:
            InputError: none was given.
        """
        if self.options.path is None:
            raise InputError(
                f"no file was given: set {self.interface}.options.path to the file of this photo"
            )
        return self.options.path

    def error_of_people_only(self, what: str) -> InputError:
        """Return the error for a map without a known pixel of the scene."""
        return InputError(
            f"{self.options.path} has no {what} outside the people, so that nothing is known of "
            "the scene: give a map of the whole photo"
        )


class DepthFile(_ResultFromFile, interfaces.MetricDepth):
    """Metric depth of the photo from a file of the user's.

    The file shows the photo with its people. Pixels in a hole of the hints are unknown.
    """

    written_for = 1
    Options = DepthFileOptions
    options: DepthFileOptions
    suffixes = DEPTH_SUFFIXES
    sees = "photo"

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return the depth (H, W) of the file in metres, NaN where it is unknown and in
        ``hints.hole``.

        Raises:
            InputError: the file cannot be read, or shows another photo.
        """
        options = self.options
        path = self.given_path()
        depth, is_relative, notes = read_depth(path, options.scale, options.invalid)
        resized, resizing = resize_nearest(depth, image.shape[0], image.shape[1], path)
        notes += resizing
        if hints.hole is not None:
            resized = np.where(hints.hole, np.nan, resized)
        if np.isnan(resized).all():
            raise self.error_of_people_only("depth")
        sigma = options.relative_sigma if is_relative else options.sigma
        if is_relative:
            notes += (
                f"{path.name} marks its depth as relative: its scale has a standard deviation of "
                f"{100 * sigma:g} %",
            )
        return DepthMap(np.asarray(resized, np.float32), None, sigma, notes)


class PointmapFile(_ResultFromFile, interfaces.RelativePointmap):
    """Point map of the photo from a file of the user's.

    The file shows the photo with its people: for the inpainted photo, points in the inpainted hole
    are invalid.
    """

    written_for = 1
    Options = PointmapFileOptions
    options: PointmapFileOptions
    suffixes = POINTMAP_SUFFIXES

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return the points (H, W, 3) of the file and their validity, without those in
        ``hints.hole``.

        Raises:
            InputError: the file cannot be read, or shows another photo.
        """
        options = self.options
        path = self.given_path()
        points, valid, notes = read_pointmap(path, options.scale)
        points_here, resizing = resize_nearest(points, image.shape[0], image.shape[1], path)
        notes += resizing
        _check_rays(path, points, valid, hints.intrinsics, has_depth=options.unknown == "scale")
        valid_here, _ = resize_nearest(valid, image.shape[0], image.shape[1], path)
        is_known = np.asarray(valid_here, np.bool_)
        if hints.hole is not None:
            is_known = is_known & ~hints.hole
        if not is_known.any():
            raise self.error_of_people_only("point")
        return Pointmap(np.asarray(points_here, np.float32), is_known, options.unknown, None, notes)


def _check_rays(
    path: Path,
    points: FloatArray,
    valid: BoolArray,
    camera: Intrinsics | None,
    *,
    has_depth: bool,
) -> None:
    """Refuse points (H, W, 3) that do not lie on the rays of a camera's pixels.

    Args:
        path: of their file.
        points: of the file.
        valid: (H, W).
        camera: of the photo, if it is known; its principal point is in the middle otherwise.
        has_depth: whether only the scale of the points is unknown, so that x / z and y / z grow in
            equal steps from the principal point.

    Raises:
        InputError: an axis has the other sign, x and y are exchanged, or the frame is another.
    """
    height, width = valid.shape
    shares = (0.5, 0.5)  # of the principal point, from the left and the top
    if camera is not None:
        shares = (camera.cx + 0.5) / camera.width, (camera.cy + 0.5) / camera.height
    rows, columns = np.nonzero(valid)
    of_x = "x", 0, columns + 0.5 - shares[0] * width
    of_y = "y", 1, rows + 0.5 - shares[1] * height
    for name, k, along in (of_x, of_y):
        values = points[..., k][valid] / points[..., 2][valid]
        if np.ptp(values) <= 0 or np.ptp(along) <= 0:
            continue
        values = np.clip(values, *np.percentile(values, [1, 99]))
        slope, middle = np.polyfit(along, values, 1)
        if slope <= 0:
            raise InputError(
                f"in {path}, {name} falls where it should grow: points are needed in the camera's "
                f"frame, with x to the right, y down, and z forward; as OpenGL and Blender have "
                f"it, (x, y, z) becomes (x, -y, -z)"
            )
        away = np.median(np.abs(values - middle - slope * along)) / slope / max(height, width)
        off = abs(middle) / slope / max(height, width)
        if has_depth and (away > _LARGEST_RESIDUAL or off > _FARTHEST_MIDDLE):
            raise InputError(
                f"in {path}, points are off the rays of the photo's pixels: {name} / z deviates "
                f"{away:.0%} of the long side from equal steps, and is zero {off:.0%} from the "
                f"principal point. Give points in the camera's frame, neither leveled nor moved"
            )
