"""Meshes and points of a result for the viewer: y up, metres, thinned out to what a browser can show several of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.upright import gltf_from_camera, transform_points
from physic_core.visual.palette import painted_contact, person_tint
from physic_core.visual.surface import depth_limit, mesh_scene
from physic_core.visual.textures.dressed import dressed_bodies

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Reconstruction

    Array = NDArray[np.float64]

_SURFACE_VERTICES, _POINTS = 60_000, 60_000
_BEHIND_M = 0.5  # the scene up to this far behind the people counts for their box
_NEAR_CAMERA_M = 6.0  # a first view shows a camera up to this far from the box
_LIFT_M = 0.003  # contact is drawn this far over the skin
_ANGLE = 0.012  # radians; a click this near to a point hits it


@dataclass(frozen=True)
class BodyShape:
    """Body of one person.

    Attributes:
        index: of the person.
        vertices: (V, 3) metres, upright frame.
        colors: (V, 3) uint8 sRGB, those of the photo, grey where it does not show the body.
        contact_vertices: (v, 3) of the part in contact, a little outside the skin.
        contact_faces: (f, 3) into ``contact_vertices``.
        contact_colors: (v, 3) uint8 sRGB, those of what is touched, faint where contact is less likely than not.
    """

    index: int
    vertices: Array
    colors: NDArray[np.uint8]
    contact_vertices: Array
    contact_faces: NDArray[np.int64]
    contact_colors: NDArray[np.uint8]


@dataclass(frozen=True)
class ResultShapes:
    """What is drawn of a result, in its upright frame: y up, floor at y = 0 if there is one.

    Attributes:
        upright: (4, 4) from the camera frame.
        faces: (F, 3) of every body.
        bodies: of the people with a body.
        surface: vertices (n, 3), faces and uint8 colours (n, 3) of the scene's mesh.
        points: (M, 3) of the scene, and their uint8 colours.
        low: (3,) corner of the box of the people and most of the scene beside them.
        high: (3,) the other corner.
    """

    upright: Array
    faces: NDArray[np.int32]
    bodies: tuple[BodyShape, ...]
    surface: tuple[Array, NDArray[np.int64], NDArray[np.uint8]]
    points: tuple[Array, NDArray[np.uint8]]
    low: Array
    high: Array

    def corners(self) -> Array:
        """Return points (N, 3) around what a first view shows: the box, and the photo's camera if it is near."""
        box = np.stack(np.meshgrid(*np.stack([self.low, self.high], 1)), -1).reshape(-1, 3)
        eye = self.upright[:3, 3]
        apart = np.linalg.norm(eye - np.clip(eye, self.low, self.high))
        return np.concatenate([box, eye[None]]) if apart < _NEAR_CAMERA_M else box


def build_shapes(result: Reconstruction) -> ResultShapes:
    """Build meshes and points of a result."""
    scene, limit, upright = result.scene, depth_limit(result), gltf_from_camera(result.scene.floor)
    mesh = mesh_scene(scene, limit, _SURFACE_VERTICES)
    stride = max(1, math.ceil(math.sqrt(scene.valid.size / _POINTS)))
    points, valid = scene.points[::stride, ::stride], scene.valid[::stride, ::stride]
    with np.errstate(invalid="ignore"):
        valid = valid & np.isfinite(points).all(-1) & (points[..., 2] < limit)
    cloud = transform_points(upright, points[valid])
    bodies = tuple(
        _body(index, result, upright)
        for index, person in enumerate(result.people)
        if np.isfinite(person.vertices).all()
    )
    low, high = _bounds(bodies, cloud)
    return ResultShapes(
        upright=upright,
        faces=result.faces,
        bodies=bodies,
        surface=(
            transform_points(upright, mesh.vertices),
            mesh.faces,
            scene.colors[mesh.pixels[:, 1], mesh.pixels[:, 0]],
        ),
        points=(cloud, scene.colors[::stride, ::stride][valid]),
        low=low,
        high=high,
    )


def _bounds(bodies: tuple[BodyShape, ...], cloud: Array) -> tuple[Array, Array]:
    """Return the box of people and most of the scene beside them; without people, of most of the scene."""
    far = min((float(body.vertices[:, 2].min()) for body in bodies), default=-math.inf) - _BEHIND_M
    near = cloud[cloud[:, 2] > far]
    corners = [np.percentile(near, [5, 95], axis=0)] if len(near) else []
    corners += [np.stack([body.vertices.min(0), body.vertices.max(0)]) for body in bodies]
    corners = corners or [np.array([[-1.0, 0.0, -3.0], [1.0, 2.0, -1.0]])]
    return np.min([low for low, _ in corners], axis=0), np.max([high for _, high in corners], axis=0)


def _body(index: int, result: Reconstruction, upright: Array) -> BodyShape:
    person, faces = result.people[index], np.asarray(result.faces, np.int64)
    vertices = transform_points(upright, person.vertices)
    touching = faces[np.asarray(person.contact, bool)[faces].all(1)]
    used, numbered = np.unique(touching, return_inverse=True)
    return BodyShape(
        index=index,
        vertices=vertices,
        colors=dressed_bodies(result).colors[index],
        contact_vertices=(vertices + _LIFT_M * vertex_normals(vertices, faces))[used],
        contact_faces=numbered.reshape(-1, 3),
        contact_colors=painted_contact(person, result.contact_partners, person_tint(index))[used],
    )


def nearest_on_ray(points: Array, origin: Array, direction: Array) -> int | None:
    """Return the index of the first of the points (N, 3) that a ray passes closely; None if it passes none.

    Args:
        points: metres.
        origin: (3,) of the ray.
        direction: (3,) of any length.
    """
    if not len(points):
        return None
    to_points = points - origin
    depth = to_points @ (direction / np.linalg.norm(direction))
    with np.errstate(invalid="ignore", divide="ignore"):
        angle = np.sqrt(np.maximum((to_points**2).sum(-1) - depth**2, 0.0)) / depth
    hit = np.flatnonzero((depth > 0) & (angle < _ANGLE))
    if not len(hit):
        return None
    first = hit[depth[hit] < depth[hit].min() + 0.05]  # of one surface, the best aimed at
    return int(first[np.argmin(angle[first])])
