"""The colours that the photo shows at points of a body; textures as picture files."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_visual.scene_mesh import cached_for_last_result
from physic_visual.textures.raster import pad_texture

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.geometry import RayCaster
    from physic_core.types import BoolArray, Float32Array, Float64Array, Reconstruction, UInt8Array


FULL_FACING = 0.45
NO_FACING = 0.15
"""Cosines between normal and ray to the camera: the photo has full weight above the first, none
below the second.
"""

SHOWN = 0.5
"""Weight in the mask above which the photo shows a point."""

RIM_SHARE = 0.006
"""Width of the rim of a mask, where colours mix with the background, as a share of the person's
height in px.
"""

REACH_SHARE = 0.04
"""Distance to the mask, as a share of the person's height, up to which a body that is not quite
under it is filled with the nearest colour of the mask.
"""

HIDDEN_M = 0.015
"""A point is hidden by a body that is nearer than it by more than this, metres."""


def photo_weights(
    points: Float64Array, normals: Float64Array, caster: RayCaster | None
) -> Float64Array:
    """Return how well the photo shows each point (n,), in 0-1: by the angle to the ray, 0 where a
    body hides it.

    Args:
        points: (n, 3) metres, on a body.
        normals: (n, 3) of any length.
        caster: of all bodies; None if no body hides another.
    """
    reach = np.linalg.norm(points, axis=1)
    facing = -(normals * points).sum(1) / np.maximum(np.linalg.norm(normals, axis=1) * reach, 1e-12)
    weight = _smoothstep((facing - NO_FACING) / (FULL_FACING - NO_FACING)) * (points[:, 2] > 0)
    if caster is not None:
        visible_rows = np.flatnonzero(weight)
        distance = caster.first(np.zeros(3), points[visible_rows]).distance
        weight[visible_rows[distance <= 1 - HIDDEN_M / reach[visible_rows]]] = 0.0
    return weight


def photo_colors(
    result: Reconstruction, index: int, points: Float64Array, weight: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the colours of the photo at points of a person.

    Args:
        result: of the photo.
        index: of the person.
        points: (n, 3) metres, on the body.
        weight: (n,) see :func:`photo_weights`.

    Returns:
        Colours (n, 3) sRGB 0-255, 0 without weight, and their weights (n,) in 0-1: in the person's
            mask, and in the mask or near it.
    """
    photo = np.zeros((len(points), 3))
    visible_share = np.zeros(len(points))
    near = np.zeros(len(points))
    visible_rows = np.flatnonzero((weight > 0) & (points[:, 2] > 0))
    photo[visible_rows], inside, close = _sample_photo(result, index, points[visible_rows])
    visible_share[visible_rows] = weight[visible_rows] * inside
    near[visible_rows] = weight[visible_rows] * close
    return photo, visible_share, near


def _smoothstep(share: Float64Array) -> Float64Array:
    t = np.clip(share, 0.0, 1.0)
    return t * t * (3 - 2 * t)


@dataclass(frozen=True)
class _MaskPicture:
    """Colours of the photo in and around the mask of a person.

    Attributes:
        corner: column and row of the photo where the picture starts.
        colors: (h, w, 3) float32 sRGB 0-255; outside of the mask those of the nearest pixel in it.
        distance: (h, w) float32 to the mask, px.
        height: of the mask, px.
    """

    corner: tuple[int, int]
    colors: Float32Array
    distance: Float32Array
    height: float


@cached_for_last_result
def _mask_pictures(result: Reconstruction) -> tuple[_MaskPicture | None, ...]:
    """Return the picture of each person's mask; None of an empty mask."""
    return tuple(_mask_picture(result.image, one.mask) for one in result.people)


def _mask_picture(image: UInt8Array, mask: BoolArray) -> _MaskPicture | None:
    import cv2

    if not mask.any():
        return None
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    height = float(np.ptp(rows)) + 1
    margin = math.ceil(REACH_SHARE * height) + 2
    window = tuple(
        slice(max(spots[0] - margin, 0), spots[-1] + margin + 1) for spots in (rows, columns)
    )
    inner = cv2.distanceTransform(np.pad(mask[window], 1).astype(np.uint8), cv2.DIST_L2, 5)[
        1:-1, 1:-1
    ]
    core = inner > min(RIM_SHARE * height, 0.5 * inner.max())
    return _MaskPicture(
        corner=(int(window[1].start), int(window[0].start)),
        colors=pad_texture(image[window], core).astype(np.float32),
        distance=cv2.distanceTransform((~core).astype(np.uint8), cv2.DIST_L2, 5),
        height=height,
    )


def _sample_photo(
    result: Reconstruction, index: int, points: Float64Array
) -> tuple[Float64Array, BoolArray, BoolArray]:
    """Return the photo's colours (n, 3) at points of its frame, and whether each is in the mask of
    a person, and near to it.

    Outside the mask the colour is that of the nearest pixel in it.
    """
    import cv2

    picture = _mask_pictures(result)[index]
    if picture is None or not len(points):
        none = np.zeros(len(points), bool)
        return np.zeros((len(points), 3)), none, none
    pixels = points @ result.intrinsics.matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        spots = (pixels[:, :2] / pixels[:, 2:]).astype(np.float32)
    x, y = (spots - np.array(picture.corner, np.float32)).T
    map_xy = [np.nan_to_num(axis, nan=-9, posinf=-9, neginf=-9) for axis in (x, y)]
    limit = 32_000  # cv2.remap takes no more rows than this
    parts = [slice(start, start + limit) for start in range(0, len(points), limit)]

    def at(values: Float32Array, outside: float) -> Float32Array:
        rows = [
            cv2.remap(
                values,
                map_xy[0][part][:, None],
                map_xy[1][part][:, None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(outside,) * 3,
            ).reshape(len(map_xy[0][part]), -1)
            for part in parts
        ]
        return np.concatenate(rows)

    far = at(picture.distance, 1e6)[:, 0]
    colors = at(picture.colors, 0.0)
    return colors.astype(np.float64), far < 0.5, far < REACH_SHARE * picture.height


def encode_image(image: NDArray[np.uint8 | np.uint16], form: Literal["JPEG", "PNG"]) -> bytes:
    """Return an image (H, W, 3) or (H, W) as a file; a PNG of (H, W) may have 16 bits."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(
        buffer, form, **({"quality": 90} if form == "JPEG" else {"optimize": True})
    )
    return buffer.getvalue()
