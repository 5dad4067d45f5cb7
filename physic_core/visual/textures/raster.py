"""Which triangle of a mesh each texel of its texture shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.visual.textures.coordinates import TextureCoordinates


@dataclass(frozen=True)
class TextureRaster:
    """Texels inside the charts of a texture of ``size`` x ``size``.

    Attributes:
        size: texels along a side.
        rows: (n,) from the top, so that v = 1 - (row + 0.5) / size.
        columns: (n,) from the left.
        faces: (n,) index of the triangle.
        corners: (n, 3) barycentric coordinates of the texel's centre.
    """

    size: int
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    faces: NDArray[np.int64]
    corners: NDArray[np.float64]

    def interpolate(self, triangles: NDArray[np.int64], values: NDArray[Any]) -> NDArray[np.float64]:
        """Return values (n, ...) at the texels of values (V, ...) at the corners of triangles (F, 3)."""
        picked: NDArray[np.float64] = np.einsum("nk,nk...->n...", self.corners, values[triangles[self.faces]])
        return picked

    def image(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values (n, ...) as an image (size, size, ...), continued over the edges of the charts."""
        image = np.zeros((self.size, self.size, *values.shape[1:]), values.dtype)
        image[self.rows, self.columns] = values
        inside = np.zeros((self.size, self.size), bool)
        inside[self.rows, self.columns] = True
        return pad_texture(image, inside)


def rasterize_texture(mesh: TextureCoordinates, size: int) -> TextureRaster:
    """Return the texels with their centre in a triangle of the mesh; the first triangle wins where two overlap."""
    places = np.stack([mesh.uv[:, 0] * size - 0.5, (1 - mesh.uv[:, 1]) * size - 0.5], 1).astype(np.float64)
    corners = places[mesh.faces]
    low = np.clip(np.ceil(corners.min(1)), 0, size).astype(np.int64)
    high = np.clip(np.floor(corners.max(1)) + 1, low, size).astype(np.int64)
    width, height = (high - low).T
    count = width * height
    face = np.repeat(np.arange(len(count)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    columns, rows = low[face, 0] + within % width[face], low[face, 1] + within // width[face]
    a, b, c = corners[face].transpose(1, 0, 2)
    spot = np.stack([columns, rows], 1)
    area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.stack([_cross(b - spot, c - spot), _cross(c - spot, a - spot), _cross(a - spot, b - spot)], 1)
        weights /= area[:, None]
    inside = np.flatnonzero((weights >= -1e-9).all(1))  # of an empty triangle they are NaN
    _, first = np.unique(rows[inside] * size + columns[inside], return_index=True)
    kept = inside[first]
    return TextureRaster(size, rows[kept], columns[kept], face[kept], weights[kept])


def pad_texture(image: NDArray[Any], inside: NDArray[np.bool_]) -> NDArray[Any]:
    """Fill the pixels outside of a mask with the value of the nearest pixel inside; image (H, W, ...)."""
    import cv2

    if not inside.any():
        return image
    _, labels = cv2.distanceTransformWithLabels(
        (~inside).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    at_label = np.zeros((labels.max() + 1, *image.shape[2:]), image.dtype)
    at_label[labels[inside]] = image[inside]
    return np.where(inside.reshape(*inside.shape, *[1] * (image.ndim - 2)), image, at_label[labels])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
