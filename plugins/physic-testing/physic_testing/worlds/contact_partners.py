"""What each contact vertex of a world touches: a surface of the scene, or another person."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.reproducible_math import dot, norm
from physic_testing.worlds.skin_patches import vertex_normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_testing.worlds.rooms import Room

__all__ = ["touched_person", "touched_surface"]

_SPACING_M = 0.012  # half the largest distance of neighbouring vertices
_DEEPEST_M = 0.05  # of bodies inside each other


def touched_surface(room: Room, vertices: FloatArray, contact: BoolArray) -> UInt8Array:
    """Return the surface nearest to each contact vertex: (N, V), index into ``SURFACE_NAMES``; 0 without contact.

    Args:
        room: of the world.
        vertices: (N, V, 3) in the room's frame, m.
        contact: (N, V).
    """
    found = np.zeros(contact.shape, np.uint8)
    found[contact] = room.nearest_surface(vertices[contact])
    return found


def touched_person(vertices: FloatArray, faces: NDArray[np.int64], outer: BoolArray, reach: float) -> NDArray[np.int16]:
    """Return the person whose skin is within ``reach`` of each outer vertex, or in which it is: (N, V), -1 for none.

    The distance is measured along the normal of the nearest vertex of the other person.

    Args:
        vertices: (N, V, 3) m.
        faces: (F, 3).
        outer: (V,), vertices that can be touched.
        reach: m.
    """
    from scipy.spatial import KDTree

    touched = np.full(vertices.shape[:2], -1, np.int16)
    least = np.full(vertices.shape[:2], np.inf)
    skin = np.flatnonzero(outer)
    for other, body in enumerate(vertices):
        tree, normals = KDTree(body[skin]), vertex_normals(body, faces)[skin]
        for i, person in enumerate(vertices):
            if i == other:
                continue
            near = np.flatnonzero(outer & ((person > body.min(0) - 0.1) & (person < body.max(0) + 0.1)).all(axis=1))
            if not len(near):
                continue
            _, index = tree.query(person[near])
            offset = person[near] - body[skin][index]
            along = dot(offset, normals[index])
            beside = norm(offset - along[:, None] * normals[index])
            distance = np.sqrt(along**2 + np.maximum(beside - _SPACING_M, 0) ** 2)
            close = (distance <= np.where(along < 0, _DEEPEST_M, reach)) & (distance < least[i, near])
            touched[i, near[close]], least[i, near[close]] = other, distance[close]
    return touched
