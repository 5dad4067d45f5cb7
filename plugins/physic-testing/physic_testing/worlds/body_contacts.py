"""True contacts with surfaces, the own body, other people and small objects, and what supports the
people.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.mesh import vertex_normals
from physic_testing.worlds.posing import rest_body
from physic_testing.worlds.reproducible_math import dot, norm
from physic_testing.worlds.solids import LEVEL_GROUND, SolidDistances

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_testing.worlds.rooms import Room

__all__ = [
    "NONE",
    "supporting_vertices",
    "touched_item",
    "touched_own_part",
    "touched_people",
    "touched_surface",
]

NONE = -1
"""Index of vertices that touch nothing."""

_SPACING = 0.012  # m, half the largest distance of neighbouring vertices
_DEEPEST = 0.012  # m of skin inside other skin; thinner than fingers, whose far side is not touched
_MARGIN = 0.05  # m around a body part
_FACING = 0.5  # cosine between normals; skin that looks the same way does not touch
_FOLDING = 0.12  # m in the T-pose; nearer vertices are one piece of skin
_CANDIDATES = 6  # nearest vertices among which one of other skin is looked for
_UPWARDS = 0.5  # cosine of the steepest surface that carries
_STEADY = 0.02  # m by which the centre of mass may lie outside its supports

# Mass of segments by Dempster: the joints between which each one's centre lies, the share of the
# way, its weight.
_MASSES = (
    ("pelvis", "neck", 0.42, 0.497),
    ("neck", "head", 1.3, 0.081),
    *((f"{s}_shoulder", f"{s}_elbow", 0.44, 0.028) for s in ("left", "right")),
    *((f"{s}_elbow", f"{s}_wrist", 0.68, 0.022) for s in ("left", "right")),
    *((f"{s}_hip", f"{s}_knee", 0.43, 0.100) for s in ("left", "right")),
    *((f"{s}_knee", f"{s}_ankle", 0.43, 0.0465) for s in ("left", "right")),
    *((f"{s}_ankle", f"{s}_foot", 0.5, 0.0145) for s in ("left", "right")),
)


def touched_own_part(model: BodyModel, vertices: FloatArray, reach: float) -> NDArray[np.int16]:
    """Return the part of the own body that each outer vertex touches: (N, V), index of the part, or
    NONE.

    A vertex touches another part if the skin there does not look the same way, is not a neighbour
    in the T-pose, and is within ``reach`` or contains the vertex.

    Args:
        model: body model of the people.
        vertices: (N, V, 3) m.
        reach: m.
    """
    outer, part, (rest, _) = (
        np.flatnonzero(model.outer.numpy()),
        model.part_of_vertex.numpy(),
        rest_body(model),
    )
    touched = np.full(vertices.shape[:2], NONE, np.int16)
    for i, body in enumerate(vertices):
        normals = vertex_normals(body, model.faces.numpy())
        least = np.full(len(body), np.inf)
        for p in range(len(model.part_names)):
            own = outer[part[outer] == p]
            low = body[own].min(axis=0) - _MARGIN
            high = body[own].max(axis=0) + _MARGIN
            others = outer[
                (part[outer] != p) & ((body[outer] > low) & (body[outer] < high)).all(axis=1)
            ]
            distance = _skin_distance(body, normals, others, own, reach, rest=rest)
            nearer = distance < least[others]
            touched[i, others[nearer]], least[others[nearer]] = p, distance[nearer]
    return touched


def touched_people(model: BodyModel, vertices: FloatArray, reach: float) -> NDArray[np.int16]:
    """Return the other person that each outer vertex touches (N, V), NONE for none.

    Args:
        model: body model of the people.
        vertices: (N, V, 3) m.
        reach: m, largest distance; vertices inside another body touch it too.
    """
    outer = np.flatnonzero(model.outer.numpy())
    part_of_vertex = model.part_of_vertex.numpy()
    person = np.full(vertices.shape[:2], NONE, np.int16)
    least = np.full(vertices.shape[:2], np.inf)
    normals = [vertex_normals(body, model.faces.numpy()) for body in vertices]
    for j, other in enumerate(vertices):
        for p in range(len(model.part_names)):
            theirs = outer[part_of_vertex[outer] == p]
            low = other[theirs].min(axis=0) - _MARGIN
            high = other[theirs].max(axis=0) + _MARGIN
            for i, body in enumerate(vertices):
                near = (
                    outer[((body[outer] > low) & (body[outer] < high)).all(axis=1)]
                    if i != j
                    else outer[:0]
                )
                if not len(near):
                    continue
                distance = _skin_distance(
                    body, normals[i], near, theirs, reach, onto=(other, normals[j])
                )
                chosen = near[distance < least[i, near]]
                least[i, near] = np.minimum(least[i, near], distance)
                person[i, chosen] = j
    return person


def touched_surface(room: Room, vertices: FloatArray, contact: BoolArray) -> UInt8Array:
    """Return the surface nearest to each contact vertex: (N, V), index into ``SURFACE_NAMES``; 0
    without contact.

    Args:
        room: of the world.
        vertices: (N, V, 3) in the room's frame, m.
        contact: (N, V).
    """
    found = np.zeros(contact.shape, np.uint8)
    found[contact] = room.nearest_surface(vertices[contact])
    return found


def touched_item(
    room: Room, outer: BoolArray, vertices: FloatArray, reach: float
) -> NDArray[np.int16]:
    """Return the small object that each outer vertex touches: (N, V), index into ``room.items``, or
    NONE.

    Args:
        room: with the objects.
        outer: (V,) vertices that can be touched.
        vertices: (N, V, 3) in the room frame, m.
        reach: m.
    """
    touched = np.full(vertices.shape[:2], NONE, np.int16)
    least = np.full(vertices.shape[:2], reach)
    for k, item in enumerate(room.items):
        blocks = [block for block in room.blocks if block.item == item]
        distance = (
            SolidDistances(blocks, LEVEL_GROUND).distances(vertices.reshape(-1, 3))[:-1].min(axis=0)
        )
        near = (distance.reshape(least.shape) <= least) & outer
        touched[near], least[near] = k, distance.reshape(least.shape)[near]
    return touched


def supporting_vertices(
    room: Room,
    model: BodyModel,
    vertices: FloatArray,
    joints: FloatArray,
    contact: BoolArray,
    touched_person: NDArray[np.int16],
) -> BoolArray:
    """Return the vertices (N, V) that carry a person.

    These are the vertices in contact with surfaces of the scene that face upwards, at most 60
    degrees steep. If the centre of mass is not above them, and not below as under a bar, those that
    lean on steeper surfaces or lie on other people carry too.

    Args:
        room: the scene.
        model: body model of the people.
        vertices: (N, V, 3) in the room frame, m.
        joints: (N, 55, 3) in the room frame, m.
        contact: (N, V) contact with the scene.
        touched_person: (N, V) as of :func:`touched_people`.
    """
    faces = model.faces.numpy()
    carrying = np.zeros(contact.shape, bool)
    for i, body in enumerate(vertices):
        towards = room.surface_normals(body[contact[i]])
        level = np.zeros(len(body), bool)
        level[contact[i]] = towards[:, 1] > _UPWARDS
        down = vertex_normals(body, faces)[:, 1] < -_UPWARDS
        if not _above(_centre_of_mass(joints[i]), body[level]):
            level = contact[i] | ((touched_person[i] != NONE) & down)
        carrying[i] = level
    return carrying


def _skin_distance(
    body: FloatArray,
    normals: FloatArray,
    ids: NDArray[np.int64],
    target: NDArray[np.int64],
    reach: float,
    *,
    rest: FloatArray | None = None,
    onto: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """Return the distance (n,) of vertices ``ids`` to the skin of ``target`` vertices, inf where
    they do not touch it.

    The distance is along the normal of the nearest vertex that does not look the same way, 0
    inside.

    Args:
        body: (V, 3) m.
        normals: (V, 3) of the body.
        ids: (n,) of the body.
        target: (m,) of the touched body.
        reach: m, largest distance of a touch.
        rest: (V, 3) T-pose of the body, if it touches itself.
        onto: vertices and normals of the touched body; by default the same body.
    """
    from scipy.spatial import cKDTree

    if not len(ids):
        return np.zeros(0)
    other, outwards = onto or (body, normals)
    count = min(_CANDIDATES, len(target))
    _, index = cKDTree(other[target]).query(body[ids], k=count)
    nearest = target[index.reshape(len(ids), count)]
    offset = body[ids][:, None] - other[nearest]
    along = dot(offset, outwards[nearest])
    beside = np.maximum(norm(offset - along[..., None] * outwards[nearest]) - _SPACING, 0)
    distance = np.sqrt(along * along + beside * beside)
    facing = dot(normals[ids][:, None], outwards[nearest]) < _FACING
    if rest is not None:
        facing &= norm(rest[ids][:, None] - rest[nearest]) > _FOLDING
    close = facing & (distance <= np.where(along < 0, _DEEPEST, reach))
    found: FloatArray = np.where(close, np.where(along < 0, 0.0, distance), np.inf).min(axis=1)
    return found


def _centre_of_mass(joints: FloatArray) -> FloatArray:
    """Return the centre of mass (3,) of a body with joints (55, 3), m."""
    centre = np.zeros(3)
    total = 0.0
    for first, second, share, weight in _MASSES:
        start = joints[JOINT_INDEX[first]]
        end = joints[JOINT_INDEX[second]]
        centre = centre + weight * (start + share * (end - start))
        total = total + weight
    return centre / total


def _above(centre: FloatArray, points: FloatArray) -> bool:
    """Return whether a point (3,) is above the convex hull of support points (n, 3), or below all
    of them.
    """
    from scipy.spatial import ConvexHull, QhullError

    if not len(points):
        return False
    if centre[1] < points[:, 1].min():
        return True
    try:
        hull = ConvexHull(points[:, [0, 2]])
    except QhullError:  # too few points, or all on one line
        return False
    return bool((hull.equations * np.append(centre[[0, 2]], 1.0)).sum(axis=1).max() <= _STEADY)
