"""Scene and bodies of the page: sub-sampled, packed, in the camera frame."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from physic_visual.palette import contact_strength
from physic_visual.scene_mesh import BACKDROP, is_near, mesh_scene, scene_meshes, scene_reach
from physic_visual.textures.dressed import dressed_bodies, dressed_images

if TYPE_CHECKING:
    from physic_core.types import (
        AnyArray,
        BoolArray,
        FloatArray,
        Int64Array,
        IntArray,
        Person,
        Reconstruction,
        UInt8Array,
    )

_STEPS = 65535

MAX_FULL_BODIES = 12
"""Most people who are shown with all their vertices; a body has 200 kB in the page, and a coarse
one 60 kB.
"""


def pack_points(points: FloatArray) -> dict[str, Any]:
    """Pack finite points (N, 3), metres, in 16 bits per axis of their bounding box.

    Returns:
        ``count``, ``origin`` and ``step`` (metres, per axis) and ``data``: N x 3 little-endian
        uint16 q in base64. A point is ``origin + step * q``; its error is at most half a step, 0.15
        mm in a box of 20 m.
    """
    points = np.asarray(points, np.float64).reshape(-1, 3)
    low = points.min(0) if len(points) else np.zeros(3)
    step = (points.max(0) - low) / _STEPS if len(points) else np.ones(3)
    step = np.where(step > 0, step, 1.0)
    levels = np.clip(np.round((points - low) / step), 0, _STEPS).astype("<u2")
    return {
        "count": len(points),
        "origin": low.tolist(),
        "step": step.tolist(),
        "data": _base64_text(levels.tobytes()),
    }


def pack_indices(indices: IntArray) -> dict[str, Any]:
    """Pack vertex ids: ``bits`` is 16 or 32, ``data`` are little-endian unsigned integers in
    base64.
    """
    bits = 16 if not indices.size or int(indices.max()) < 1 << 16 else 32
    return {
        "bits": bits,
        "data": _base64_text(np.ascontiguousarray(indices, f"<u{bits // 8}").tobytes()),
    }


def pack_bytes(values: AnyArray) -> str:
    """Pack integers from 0 to 255 in base64."""
    return _base64_text(np.ascontiguousarray(values, np.uint8).tobytes())


def pack_flags(flags: BoolArray) -> str:
    """Pack flags as bits, the first one the lowest of the first byte, in base64."""
    return _base64_text(np.packbits(flags.ravel(), bitorder="little").tobytes())


def photo_jpeg(image: UInt8Array, longest: int, quality: int) -> str:
    """Return an image (H, W, 3) RGB as a data URL of a JPEG, with its longer side reduced to
    ``longest`` px at most.
    """
    picture = Image.fromarray(np.ascontiguousarray(image))
    picture.thumbnail((longest, longest))
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=quality)
    return f"data:image/jpeg;base64,{_base64_text(buffer.getvalue())}"


def _base64_text(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


_CROWD_SCENE_VERTICES = 70_000


def pack_scene(reconstruction: Reconstruction) -> dict[str, Any]:
    """Pack the scene: every n-th valid pixel as a point, and the triangles between those on one
    surface.

    Returns:
        ``stride`` n in px, ``rows`` and ``columns`` of the grid, ``valid`` (one flag per grid
        point), ``points`` (of the valid ones, in the order of the grid), ``triangles`` (two flags
        per grid point: the triangles below and to the right of it that are part of the mesh) and
        ``backdrop``: ``points``, ``faces``, ``pixels`` (column and row of each point, px), what it
        means, and its ``radius`` in metres.
    """
    scene = reconstruction.scene
    limit = scene_reach(reconstruction)
    surface, backdrop = scene_meshes(reconstruction)
    if len(reconstruction.people) > MAX_FULL_BODIES:
        surface = mesh_scene(scene, limit, _CROWD_SCENE_VERTICES)
    stride = surface.stride
    points = np.asarray(scene.points[::stride, ::stride], np.float32)
    valid = scene.valid[::stride, ::stride] & is_near(points, limit)
    triangles = np.zeros((*valid.shape, 2), bool)
    corner = surface.pixels[surface.faces] // stride  # (F, 3, 2): column and row in the grid
    # Both triangles of a cell have its lower left and upper right corner, in the places that
    # mesh_scene gives them.
    upper = corner[:, 0, 0] == corner[:, 1, 0]
    triangles[corner[upper, 0, 1], corner[upper, 0, 0], 0] = True
    triangles[corner[~upper, 0, 1], corner[~upper, 1, 0], 1] = True
    return {
        "stride": stride,
        "rows": valid.shape[0],
        "columns": valid.shape[1],
        "valid": pack_flags(valid),
        "points": pack_points(points[valid]),
        "triangles": pack_flags(triangles),
        "backdrop": {
            "points": pack_points(backdrop.vertices),
            "faces": pack_indices(backdrop.faces),
            "pixels": pack_indices(backdrop.pixels),
            "meaning": BACKDROP,
            "radius": limit,
        },
    }


def pack_bodies(reconstruction: Reconstruction) -> dict[str, Any]:
    """Pack the faces of all bodies, and vertices, colours and contact of each; of a crowd with
    fewer vertices.

    Returns:
        ``faces``; ``split``, the vertex of each index in ``faces`` from the number of vertices on,
        and ``uv`` of all indices if bodies have textures, else None; and, for each person,
        ``people``: ``points``; ``texture`` (a data URL), or ``colors`` of the vertices
        (three bytes sRGB each); ``contact``, a byte per vertex, from 0 without contact to 255 for
        likely contact; ``partner``, the index into ``partners`` plus one, 0 without contact (None
        in a result without partners). A person without a body is None.
    """
    people = reconstruction.people
    dressed = dressed_bodies(reconstruction)
    faces = np.asarray(reconstruction.faces, np.int64)
    bodies = [person for person in people if person.has_body]
    ids = np.arange(len(bodies[0].vertices)) if bodies else np.zeros(0, np.int64)
    groups = ids
    mesh = dressed.mesh
    whole = len(bodies) <= MAX_FULL_BODIES
    if not whole:
        ids, faces, groups = _coarse(bodies[0].vertices, faces)
        mesh = None
    if mesh is not None:
        faces = mesh.faces
    images = {} if mesh is None else dressed_images(reconstruction)

    def pack(index: int, person: Person) -> dict[str, Any]:
        body = dressed.people[index]
        texture = None if mesh is None else photo_jpeg(images[index], len(images[index]), 88)
        return {
            "points": pack_points(person.vertices[ids]),
            "texture": texture,
            "colors": pack_bytes(body.colors[ids]) if texture is None else None,
            "contact": _pack_contact(person, groups, len(ids)),
            "partner": _pack_partner(person, groups, len(ids)),
        }

    return {
        "faces": pack_indices(faces if bodies else np.zeros((0, 3), np.int64)),
        "split": None if mesh is None else pack_indices(mesh.vertex[len(ids) :]),
        "uv": None if mesh is None else pack_indices(np.round(65535 * mesh.uv).astype(np.int64)),
        "people": [
            pack(index, person) if person.has_body else None for index, person in enumerate(people)
        ],
    }


_COARSE_M = 0.02  # spacing of the vertices of coarse bodies, metres


def _coarse(vertices: FloatArray, faces: Int64Array) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Return ids (v,) of the vertices that are kept, faces between them, and the kept one (V,) for
    each vertex.
    """
    import torch

    from physic_core.geometry import coarse_mesh

    body = torch.from_numpy(np.array(vertices, np.float64))
    parts = torch.zeros(len(vertices), dtype=torch.int64)
    mesh = coarse_mesh(body, torch.from_numpy(faces), parts, _COARSE_M)
    return mesh.ids.numpy(), mesh.faces.numpy(), mesh.of_vertex.numpy()


def _pack_contact(person: Person, groups: Int64Array, count: int) -> str:
    """Pack the contact of each of ``count`` groups of vertices, the strongest of its vertices."""
    strength = np.zeros(count)
    np.maximum.at(strength, groups, contact_strength(person))
    return pack_bytes(np.ceil(255 * strength))


def _pack_partner(person: Person, groups: Int64Array, count: int) -> dict[str, Any] | None:
    """Pack the partner of each of ``count`` groups of vertices, the greatest index of its
    vertices.
    """
    if person.contact_partner is None:
        return None
    partner = np.zeros(count, np.int64)
    np.maximum.at(partner, groups, np.asarray(person.contact_partner, np.int64) + 1)
    return pack_indices(partner)
