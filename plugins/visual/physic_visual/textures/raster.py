"""Texture coordinates of the body meshes, and which triangle each texel of a texture shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array

from physic_core.errors import BodyModelError
from physic_core.files import read_arrays

if TYPE_CHECKING:
    from physic_core.types import (
        AnyArray,
        BoolArray,
        Float32Array,
        Float64Array,
        FloatArray,
        Int64Array,
        IntArray,
    )


_TEXELS = 32_000  # texels at a time


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
    rows: Int64Array
    columns: Int64Array
    faces: Int64Array
    corners: Float64Array

    def parts(self) -> Iterator[TextureRaster]:
        """Yield the texels in blocks."""
        for start in range(0, len(self.rows), _TEXELS):
            rows = slice(start, start + _TEXELS)
            yield TextureRaster(
                self.size, self.rows[rows], self.columns[rows], self.faces[rows], self.corners[rows]
            )

    def interpolate(self, triangles: Int64Array, values: AnyArray) -> Float64Array:
        """Return values (n, ...) at the texels of values (V, ...) at the corners of triangles (F,
        3).
        """
        ends = np.arange(0, self.corners.size + 1, 3)
        weights = csr_array(
            (self.corners.ravel(), triangles[self.faces].ravel(), ends),
            shape=(len(self.faces), len(values)),
        )
        picked: Float64Array = weights @ values
        return picked

    def image(self, values: AnyArray) -> AnyArray:
        """Return values (n, ...) as an image (size, size, ...), continued over the edges of the
        charts.
        """
        return values[self._nearest]

    @cached_property
    def _nearest(self) -> Int64Array:
        """Texel whose value each pixel (size, size) of an image has."""
        inside = np.zeros((self.size, self.size), bool)
        inside[self.rows, self.columns] = True
        number = np.zeros((self.size, self.size), np.int64)
        number[self.rows, self.columns] = np.arange(len(self.rows))
        return pad_texture(number, inside)


def rasterize_texture(mesh: TextureCoordinates, size: int) -> TextureRaster:
    """Return the texels with their centre in a triangle of the mesh: rays through a flat texture
    find them.
    """
    from physic_core.geometry import RayCaster

    u, v = mesh.uv.astype(np.float64).T
    flat = np.stack([u * size - 0.5, (1 - v) * size - 0.5, np.zeros(len(u))], 1)
    rows, columns = np.indices((size, size)).reshape(2, -1)
    starts = np.stack([columns, rows, np.full(size * size, -1.0)], 1)
    hits = RayCaster(flat, mesh.faces).first(starts, np.broadcast_to([0.0, 0, 1], starts.shape))
    inside = np.flatnonzero(hits.face >= 0)
    return TextureRaster(
        size, rows[inside], columns[inside], hits.face[inside], hits.barycentric[inside]
    )


def pad_texture(image: AnyArray, inside: BoolArray) -> AnyArray:
    """Fill the pixels outside of a mask with the value of the nearest pixel inside; image (H, W,
    ...).
    """
    import cv2

    if not inside.any():
        return image
    _, labels = cv2.distanceTransformWithLabels(
        (~inside).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    at_label = np.zeros((labels.max() + 1, *image.shape[2:]), image.dtype)
    at_label[labels[inside]] = image[inside]
    return np.where(inside.reshape(*inside.shape, *[1] * (image.ndim - 2)), image, at_label[labels])


@dataclass(frozen=True)
class TextureCoordinates:
    """Mesh with one texture coordinate per vertex: the body's, with the vertices on seams split.

    Attributes:
        uv: (U, 2) float32 in 0-1, u right and v up.
        vertex: (U,) int64 index of the body's vertex. The first V are 0 to V - 1, the rest are the
            split ones.
        faces: (F, 3) int64 indices into ``uv``; the triangles of the body in their order.
    """

    uv: Float32Array
    vertex: Int64Array
    faces: Int64Array


def load_texture_coordinates(source: str | Path, faces: IntArray) -> TextureCoordinates:
    """Load the texture coordinates of the embedded body, or ``vt`` and ``ft`` of a SMPL-X file.

    Args:
        source: "embedded", or the path of the file.
        faces: (F, 3) of the body model.

    Raises:
        BodyModelError: the file has none.
    """
    triangles: Int64Array = np.array(faces, np.int64)
    if source == "embedded":
        with (
            as_file(files("physic_core.body").joinpath("embedded_uv.npz")) as path,
            np.load(path) as file,
        ):
            vertex = np.r_[np.arange(triangles.max() + 1), file["split"]]
            triangles.reshape(-1)[file["corner"]] = file["index"]
            return TextureCoordinates(file["uv"].astype(np.float32) / 65535, vertex, triangles)
    try:
        with Path(source).open("rb") as stream:
            arrays = read_arrays(stream, ("ft", "vt"))
        return split_at_seams(triangles, arrays["ft"].astype(np.int64), arrays["vt"])
    except Exception as error:  # of zipfile and numpy, which have many
        raise BodyModelError(
            f"{source} has no usable texture coordinates (the arrays vt and ft, which official "
            "SMPL-X files have): give another file"
        ) from error


def split_at_seams(faces: Int64Array, corners: Int64Array, uv: FloatArray) -> TextureCoordinates:
    """Return a mesh with one coordinate per vertex, of faces (F, 3) and the coordinates (F, 3) of
    their corners.

    Args:
        faces: (F, 3) indices of vertices; each vertex has a face.
        corners: (F, 3) indices into ``uv``.
        uv: (T, 2) in 0-1, v up.
    """
    pairs, inverse = np.unique(
        np.stack([faces.ravel(), corners.ravel()], 1), axis=0, return_inverse=True
    )
    first = np.r_[True, pairs[1:, 0] != pairs[:-1, 0]]
    order = np.argsort(~first, kind="stable")  # one of each vertex, then the split ones
    new_index = np.empty(len(order), np.int64)
    new_index[order] = np.arange(len(order))
    return TextureCoordinates(
        uv[pairs[order, 1]].astype(np.float32),
        pairs[order, 0],
        new_index[inverse.reshape(faces.shape)],
    )
