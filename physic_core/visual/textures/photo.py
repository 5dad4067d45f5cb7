"""The colours that the photo shows at points of a body; textures as picture files."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from physic_core.visual.textures.raster import pad_texture

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.geometry.rays import RayCaster
    from physic_core.types import Reconstruction

    Array = NDArray[np.float64]

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


def photo_colors(
    result: Reconstruction, index: int, points: Array, normals: Array, caster: RayCaster | None
) -> tuple[Array, Array, Array]:
    """Return the colours of the photo at points of a person.

    Args:
        result: of the photo.
        index: of the person.
        points: (n, 3) metres, on the body.
        normals: (n, 3) of any length.
        caster: of all bodies; None if no body hides another.

    Returns:
        Colours (n, 3) sRGB 0-255, and their weights (n,) in 0-1: in the person's mask, and in the
            mask or near it.
    """
    reach = np.linalg.norm(points, axis=1)
    facing = -(normals * points).sum(1) / np.maximum(np.linalg.norm(normals, axis=1) * reach, 1e-12)
    weight = _smooth((facing - NO_FACING) / (FULL_FACING - NO_FACING))
    candidate = np.flatnonzero((weight > 0) & (points[:, 2] > 0))
    visible = np.zeros(len(points), bool)
    distance = 1.0 if caster is None else caster.first(np.zeros(3), points[candidate]).distance
    visible[candidate] = distance > 1 - HIDDEN_M / reach[candidate]
    photo, shown, near = _sample(result, np.asarray(result.people[index].mask, bool), points)
    return photo, weight * (visible & shown), weight * (visible & near)


def _smooth(share: Array) -> Array:
    t = np.clip(share, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def _sample(
    result: Reconstruction, mask: NDArray[np.bool_], points: Array
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the photo's colours (n, 3) at points of its frame, and whether each is in the mask,
    and near to it.

    Outside the mask (H, W) the colour is that of the nearest pixel in it.
    """
    import cv2

    if not mask.any():
        none = np.zeros(len(points), bool)
        return np.zeros((len(points), 3)), none, none
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
    outer = np.full(mask.shape, 1e6, np.float32)
    outer[window] = cv2.distanceTransform((~core).astype(np.uint8), cv2.DIST_L2, 5)
    image = np.zeros(result.image.shape, np.float32)
    image[window] = pad_texture(result.image[window], core)
    pixels = points @ result.intrinsics.matrix.T
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (pixels[:, :2] / pixels[:, 2:]).T.astype(np.float32)
    place = (
        np.nan_to_num(x, nan=-9, posinf=-9, neginf=-9),
        np.nan_to_num(y, nan=-9, posinf=-9, neginf=-9),
    )
    limit = 32_000  # cv2.remap takes no more rows than this
    parts = [slice(start, start + limit) for start in range(0, len(points), limit)]

    def at(picture: NDArray[np.float32], outside: float) -> NDArray[np.float32]:
        rows = [
            cv2.remap(
                picture,
                place[0][part][:, None],
                place[1][part][:, None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
                borderValue=(outside,) * 3,
            ).reshape(len(place[0][part]), -1)
            for part in parts
        ]
        return np.concatenate(rows)

    far = at(outer, 1e6)[:, 0]
    colors = at(image, 0.0)
    return colors.astype(np.float64), far < 0.5, far < REACH_SHARE * height


def encode_image(image: NDArray[np.uint8 | np.uint16], form: Literal["JPEG", "PNG"]) -> bytes:
    """Return an image (H, W, 3) or (H, W) as a file; a PNG of (H, W) may have 16 bits."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(
        buffer, form, **({"quality": 90} if form == "JPEG" else {"optimize": True})
    )
    return buffer.getvalue()
