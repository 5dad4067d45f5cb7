"""Skinned GLB: bodies with skeleton and pose, contact, scene, floor and camera; metres, y up."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import roma
import torch

from physic_core.geometry.upright import transform_points
from physic_core.visual.export.glb_buffer import ARRAY, INDICES, GlbBuffer
from physic_core.visual.export.meshes import body_colors, floor_square, vertex_normals
from physic_core.visual.export.request import ExportedFiles, ExportRequest, camera_pose
from physic_core.visual.export.rig import Rig, rigs
from physic_core.visual.surface import depth_limit, mesh_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Intrinsics, Person, UInt8Array

__all__ = ["export_glb", "influences"]

_WEIGHT_LOSS = 1e-3
"""Maximum sum of the weights beyond four influences of a vertex; with more, eight are written."""

_SCENE, _BODY, _FLOOR = 0, 1, 2
_MATERIALS = (
    {
        "name": "photo",
        "doubleSided": True,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0},
        "extensions": {"KHR_materials_unlit": {}},
    },
    {"name": "mannequin", "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}},
    {
        "name": "floor",
        "doubleSided": True,
        "alphaMode": "BLEND",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.15, 0.5, 0.25, 0.35],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        },
    },
)


def export_glb(request: ExportRequest) -> ExportedFiles:
    """Return a GLB file; its people are skinned meshes with the names and the order of the SMPL-X joints."""
    glb = GlbBuffer(generator="PhySIC")
    result, frame, nodes = request.result, request.frame, list[int]()
    used: list[int] = []
    if request.scene:
        nodes += _add_scene(glb, request, used)
        nodes += _add_floor(glb, request, used)
    notes = []
    for index, rig in rigs(request):
        nodes += _add_person(glb, f"person_{index}", rig, result.people[index], _material(used, _BODY))
        lost = float(1 - influences(rig.weights)[1].sum(1).min())
        if lost > _WEIGHT_LOSS:
            notes.append(f"person {index}: skinning weights beyond eight joints are left out (at most {lost:.3f})")
    nodes.append(_add_camera(glb, result.intrinsics, camera_pose(frame)))
    _add_materials(glb, used)
    glb.tree["scenes"] = [
        {
            "name": "physic",
            "nodes": nodes,
            "extras": {
                "units": "metres",
                "axes": frame.axes,
                "gltf_from_camera": frame.from_camera.tolist(),
                "body_model": result.body_model,
                "rest_pose": "T-pose at zero rotations of the joints",
                "contact": "vertex attribute _CONTACT: 1 in contact, 0 not",
            },
        }
    ]
    glb.tree["scene"] = 0
    offset = math.dist(_center(result.intrinsics), (result.intrinsics.cx, result.intrinsics.cy))
    if offset > 1.0:
        notes.append(
            f"the principal point is {offset:.0f} px from the image centre, which a glTF camera cannot state: "
            "a render of the camera is shifted by that"
        )
    return ExportedFiles({f"{request.stem}{request.suffix}": glb.content()}, tuple(notes))


def influences(weights: NDArray[np.floating[Any]]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return joints and weights (V, 4) or (V, 8) of each vertex: the largest, normalised if little was lost.

    Eight are used if more than 0.001 of a vertex lies beyond four. A joint of weight 0 is 0, as glTF demands.
    """
    order = np.argsort(-weights, axis=1, kind="stable")
    ranked = np.take_along_axis(weights, order, 1)
    count = 4 if (1 - ranked[:, :4].sum(1)).max() <= _WEIGHT_LOSS else 8
    kept = ranked[:, :count] / ranked[:, :count].sum(1, keepdims=True)
    kept = kept.astype(np.float32)
    return np.where(kept > 0, order[:, :count], 0).astype(np.uint8), kept


def _material(used: list[int], kind: int) -> int:
    """Return the index of a material in the file, which has only the materials in use."""
    if kind not in used:
        used.append(kind)
    return used.index(kind)


def _add_materials(glb: GlbBuffer, used: list[int]) -> None:
    if used:
        glb.tree["materials"] = [_MATERIALS[kind] for kind in used]
    if _SCENE in used:
        glb.tree["extensionsUsed"] = ["KHR_materials_unlit"]


def _add_person(glb: GlbBuffer, name: str, rig: Rig, person: Person, material: int) -> list[int]:
    """Add mesh, skin and joint nodes of a person, and return the indices of the nodes at the top."""
    quaternions = roma.rotmat_to_unitquat(torch.from_numpy(rig.rotations)).numpy()
    first = len(glb.tree.get("nodes", ()))
    for joint, joint_name in enumerate(rig.names):
        node: dict[str, Any] = {
            "name": joint_name,
            "rotation": quaternions[joint].tolist(),
            "translation": rig.offsets[joint].tolist(),
        }
        children = [first + child for child, parent in enumerate(rig.parents) if parent == joint]
        if children:
            node["children"] = children
        glb.add("nodes", node)
    joints = list(range(first, first + len(rig.names)))
    inverse = glb.accessor(rig.inverse_bind.astype(np.float32))
    # A node of its own above each skeleton: Blender makes one armature of skeletons with a common parent.
    top = glb.add("nodes", {"name": f"{name}_skeleton", "children": [first]})
    skin = glb.add("skins", {"name": name, "inverseBindMatrices": inverse, "joints": joints, "skeleton": top})
    indices, weights = influences(rig.weights)
    attributes = {
        "POSITION": glb.accessor(rig.vertices.astype(np.float32), ARRAY, bounds=True),
        "NORMAL": glb.accessor(vertex_normals(rig.vertices, rig.faces), ARRAY),
        "COLOR_0": glb.accessor(body_colors(person.contact, linear=True), ARRAY, normalized=True),
        "_CONTACT": glb.accessor(person.contact.astype(np.float32), ARRAY),
    }
    for group in range(indices.shape[1] // 4):
        columns = slice(4 * group, 4 * group + 4)
        attributes[f"JOINTS_{group}"] = glb.accessor(indices[:, columns], ARRAY)
        attributes[f"WEIGHTS_{group}"] = glb.accessor(weights[:, columns], ARRAY)
    faces = glb.accessor(rig.faces.reshape(-1).astype(np.uint32), INDICES)
    primitive = {"attributes": attributes, "indices": faces, "material": material}
    mesh = glb.add("meshes", {"name": name, "primitives": [primitive]})
    return [top, glb.add("nodes", {"name": name, "mesh": mesh, "skin": skin})]


def _add_scene(glb: GlbBuffer, request: ExportRequest, used: list[int]) -> list[int]:
    """Add the textured scene mesh, and return the index of its node."""
    scene = request.result.scene
    surface = mesh_scene(scene, depth_limit(request.result))
    if not len(surface.faces):
        return []
    texture, (width, height) = _power_of_two(scene.colors)
    uv = (surface.pixels + 0.5) / [width, height]
    glb.tree["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
    glb.tree["images"] = [{"bufferView": glb.view(texture), "mimeType": "image/jpeg", "name": "photo"}]
    glb.tree["textures"] = [{"source": 0, "sampler": 0}]
    vertices = transform_points(request.frame.from_camera, surface.vertices)
    attributes = {
        "POSITION": glb.accessor(vertices.astype(np.float32), ARRAY, bounds=True),
        "TEXCOORD_0": glb.accessor(uv.astype(np.float32), ARRAY),
    }
    faces = glb.accessor(surface.faces.reshape(-1).astype(np.uint32), INDICES)
    primitive = {"attributes": attributes, "indices": faces, "material": _material(used, _SCENE)}
    mesh = glb.add("meshes", {"name": "scene", "primitives": [primitive]})
    return [glb.add("nodes", {"name": "scene", "mesh": mesh})]


def _add_floor(glb: GlbBuffer, request: ExportRequest, used: list[int]) -> list[int]:
    """Add the floor as a square, if there is one, and return the index of its node."""
    square = floor_square(request.result, request.frame)
    if square is None:
        return []
    vertices, faces = square
    normals = np.broadcast_to(request.frame.up_vector, vertices.shape)
    attributes = {
        "POSITION": glb.accessor(vertices.astype(np.float32), ARRAY, bounds=True),
        "NORMAL": glb.accessor(normals.astype(np.float32), ARRAY),
    }
    indices = glb.accessor(faces.reshape(-1).astype(np.uint16), INDICES)
    primitive = {"attributes": attributes, "indices": indices, "material": _material(used, _FLOOR)}
    mesh = glb.add("meshes", {"name": "floor", "primitives": [primitive]})
    return [glb.add("nodes", {"name": "floor", "mesh": mesh})]


def _add_camera(glb: GlbBuffer, camera: Intrinsics, pose: NDArray[np.float64]) -> int:
    """Add the camera of the photo, and return the index of its node."""
    height, width = camera.height / camera.fy, camera.width / camera.fx
    perspective = {"yfov": 2 * math.atan(height / 2), "aspectRatio": width / height, "znear": 0.05, "zfar": 1000.0}
    entry = {
        "name": "photo",
        "type": "perspective",
        "perspective": perspective,
        "extras": {"intrinsics_px": camera.matrix.tolist(), "size_px": [camera.width, camera.height]},
    }
    quaternion = roma.rotmat_to_unitquat(torch.from_numpy(pose[:3, :3].copy())).numpy()
    node = {
        "name": "camera",
        "camera": glb.add("cameras", entry),
        "rotation": quaternion.tolist(),
        "translation": pose[:3, 3].tolist(),
    }
    return glb.add("nodes", node)


def _center(camera: Intrinsics) -> tuple[float, float]:
    return (camera.width - 1) / 2, (camera.height - 1) / 2


def _power_of_two(image: UInt8Array) -> tuple[bytes, tuple[int, int]]:
    """Return a JPEG of an image, padded at the right and the bottom to powers of two, and its width and height.

    Old engines cannot make mipmaps of other sizes.
    """
    from PIL import Image

    height, width = (1 << (side - 1).bit_length() for side in image.shape[:2])
    padded = np.pad(image, ((0, height - image.shape[0]), (0, width - image.shape[1]), (0, 0)), mode="edge")
    buffer = io.BytesIO()
    Image.fromarray(padded).save(buffer, "JPEG", quality=90)
    return buffer.getvalue(), (width, height)
