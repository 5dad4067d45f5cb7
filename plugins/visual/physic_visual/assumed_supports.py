"""What carries people and the photo does not show: a flat slab under each assumed seat, step or
handhold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry import up_in_camera, vertex_normals

if TYPE_CHECKING:
    from physic_core.types import ContactPartner, Float64Array, Int64Array, Person, Reconstruction


SLAB_FACES: Int64Array = np.array(
    [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], *([i, (i + 1) % 4, 4 + i] for i in range(4))]
    + [[(i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
)
"""Triangles (12, 3) of a slab, counter-clockwise from outside."""

_THICK_M = 0.03  # thickness of a slab
_MARGIN_M = 0.04  # reach of a slab beyond the skin on it
_LEAST = 3  # vertices
_LEVEL = 0.5  # least cosine between the skin's mean normal and the vertical of a level slab


@dataclass(frozen=True)
class AssumedSupport:
    """A support that the result assumes, since the photo does not show what carries a person.

    Attributes:
        person: index of the person.
        name: such as "assumed seat".
        vertices: (8, 3) metres, camera frame, corners of a slab with the faces :data:`SLAB_FACES`.
    """

    person: int
    name: str
    vertices: Float64Array


def assumed_supports(result: Reconstruction) -> list[AssumedSupport]:
    """Return the assumed supports of the people of a result."""
    supports = list[AssumedSupport]()
    up = np.asarray(up_in_camera(result.scene.level), np.float64)
    for index, person in enumerate(result.people):
        if person.contact_partner is None or not person.has_body:
            continue
        vertices = person.vertices.astype(np.float64)
        for number, partner in enumerate(result.contact_partners):
            on = person.contact_partner == number
            if not partner.in_scene and on.sum() >= _LEAST:
                normals = vertex_normals(vertices, np.asarray(result.faces, np.int64))
                supports.append(
                    AssumedSupport(
                        index,
                        _support_name(person, partner),
                        _slab_below(vertices[on], normals[on], up),
                    )
                )
    return supports


def _support_name(person: Person, partner: ContactPartner) -> str:
    """Return "assumed seat", "assumed handhold", ...: what the support of the person says of this
    partner.
    """
    names = person.support.hidden if person.support is not None else ()
    candidates = (name for name in names if (name == partner.title) or not partner.surface)
    name = next(candidates, partner.title).removeprefix("hidden ")
    return f"assumed {name.partition(' under ')[0].partition(' behind ')[0]}"


def _slab_below(vertices: Float64Array, normals: Float64Array, up: Float64Array) -> Float64Array:
    """Return the corners (8, 3) of the smallest slab that skin (n, 3) lies on.

    It is level, or upright behind skin that faces sideways. Hands hold the middle of it.
    """
    import cv2

    facing = normals.mean(0)
    beside = facing - (facing @ up) * up
    is_level = abs(facing @ up) >= _LEVEL * np.linalg.norm(facing)
    axis = up if is_level else beside / np.linalg.norm(beside)
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    plane = np.stack([first / np.linalg.norm(first), np.cross(axis, first) / np.linalg.norm(first)])
    center, size, angle = cv2.minAreaRect((vertices @ plane.T).astype(np.float32))
    corners = (
        cv2.boxPoints((center, (size[0] + 2 * _MARGIN_M, size[1] + 2 * _MARGIN_M), angle)) @ plane
    )
    # Around a bar, skin faces every way.
    side = int(facing @ axis > _LEVEL) - int(facing @ axis < -_LEVEL)
    low = np.median(vertices @ axis) + (side - 1) / 2 * _THICK_M
    slab: Float64Array = np.concatenate([corners + low * axis, corners + (low + _THICK_M) * axis])
    a, b, c = slab[:3]
    return slab if np.cross(b - a, c - a) @ axis > 0 else slab[[3, 2, 1, 0, 7, 6, 5, 4]]
