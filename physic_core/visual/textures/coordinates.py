"""Texture coordinates of the body meshes: those of the embedded body, and those in a user's SMPL-X file."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physic_core.errors import BodyModelError
from physic_core.files.npz import read_arrays


@dataclass(frozen=True)
class TextureCoordinates:
    """Mesh with one texture coordinate per vertex: the body's, with the vertices on seams split.

    Attributes:
        uv: (U, 2) float32 in 0-1, u right and v up.
        vertex: (U,) int64 index of the body's vertex. The first V are 0 to V - 1, the rest are the split ones.
        faces: (F, 3) int64 indices into ``uv``; the triangles of the body in their order.
    """

    uv: NDArray[np.float32]
    vertex: NDArray[np.int64]
    faces: NDArray[np.int64]


def load_texture_coordinates(source: str | Path, faces: NDArray[np.integer[Any]]) -> TextureCoordinates:
    """Load the texture coordinates of the embedded body, or ``vt`` and ``ft`` of a SMPL-X file.

    Args:
        source: "embedded", or the path of the file.
        faces: (F, 3) of the body model.

    Raises:
        BodyModelError: the file has none.
    """
    triangles: NDArray[np.int64] = np.array(faces, np.int64)
    if source == "embedded":
        with as_file(files("physic_core.body").joinpath("embedded_uv.npz")) as path, np.load(path) as file:
            vertex = np.r_[np.arange(triangles.max() + 1), file["split"]]
            triangles.reshape(-1)[file["corner"]] = file["index"]
            return TextureCoordinates(file["uv"].astype(np.float32) / 65535, vertex, triangles)
    try:
        with Path(source).open("rb") as stream:
            arrays = read_arrays(stream, ("ft", "vt"))
        return split_at_seams(triangles, arrays["ft"].astype(np.int64), arrays["vt"])
    except Exception as error:  # of zipfile and numpy, which have many
        raise BodyModelError(
            f"{source} has no usable texture coordinates (the arrays vt and ft, which official SMPL-X files have): "
            "give another file"
        ) from error


def split_at_seams(
    faces: NDArray[np.int64], corners: NDArray[np.int64], uv: NDArray[np.floating[Any]]
) -> TextureCoordinates:
    """Return a mesh with one coordinate per vertex, of faces (F, 3) and the coordinates (F, 3) of their corners.

    Args:
        faces: (F, 3) indices of vertices; each vertex has a face.
        corners: (F, 3) indices into ``uv``.
        uv: (T, 2) in 0-1, v up.
    """
    pairs, inverse = np.unique(np.stack([faces.ravel(), corners.ravel()], 1), axis=0, return_inverse=True)
    first = np.r_[True, pairs[1:, 0] != pairs[:-1, 0]]
    order = np.argsort(~first, kind="stable")  # one of each vertex, then the split ones
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return TextureCoordinates(
        uv[pairs[order, 1]].astype(np.float32), pairs[order, 0], place[inverse.reshape(faces.shape)]
    )
