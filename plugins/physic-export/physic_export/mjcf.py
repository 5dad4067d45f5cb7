"""MJCF: the scene as closed convex meshes, the floor as a plane, people as mocap bodies; metres, z up."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import roma
import torch

from physic_core import ExportedFiles, ExportRequest
from physic_core.errors import InputError
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import camera_pose
from physic_core.visual.rig import body_of_result
from physic_export.tiles import convex_tiles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Person

__all__ = ["export_mjcf"]

_SKIN = "0.77 0.75 0.73 1"
_FRICTION = "0.8 0.005 0.0001"


def export_mjcf(request: ExportRequest) -> ExportedFiles:
    """Return one MJCF file without other files.

    - ``floor``: an infinite plane at z = 0; gravity is -9.81 m/s2 along z.
    - ``scene_0``, ...: the scene above the floor, as closed convex tiles of 0.1 m thickness.
    - ``person_0``, ...: mocap bodies at the pelvis; a visual mesh (group 2), and the hull of each body part for
      collisions (group 3).
    - camera ``photo``: that of the photo.
    """
    result, matrix = request.result, request.frame.from_camera
    root = ElementTree.Element("mujoco", model="physic")
    root.append(ElementTree.Comment(f" PhySIC; metres; {request.frame.axes} "))
    ElementTree.SubElement(root, "compiler", angle="radian")
    ElementTree.SubElement(root, "option", gravity="0 0 -9.81", timestep="0.002")
    visual = ElementTree.SubElement(root, "visual")
    camera = result.intrinsics
    ElementTree.SubElement(visual, "global", offwidth=str(camera.width), offheight=str(camera.height))
    ElementTree.SubElement(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.6 0.6 0.6", specular="0 0 0")
    ElementTree.SubElement(visual, "map", znear="0.01")
    asset, world = ElementTree.SubElement(root, "asset"), ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(
        world, "geom", name="floor", type="plane", size="0 0 1", rgba="0.55 0.58 0.55 1", friction=_FRICTION
    )
    tiles = convex_tiles(result) if request.scene else []
    for number, tile in enumerate(tiles):
        name = f"scene_{number}"
        _mesh(asset, name, transform_points(matrix, tile.vertices), tile.faces)
        rgba = " ".join(f"{v:.3f}" for v in [*tile.color, 1.0])
        ElementTree.SubElement(world, "geom", name=name, type="mesh", mesh=name, rgba=rgba, friction=_FRICTION)
    if request.people:
        model = body_of_result(result, request.body_file)
        for index, person in request.chosen():
            _person(asset, world, f"person_{index}", person, model, matrix)
    pose = camera_pose(request.frame)
    quaternion = roma.rotmat_to_unitquat(torch.from_numpy(pose[:3, :3].copy())).numpy()
    ElementTree.SubElement(
        world,
        "camera",
        name="photo",
        pos=_numbers(pose[:3, 3]),
        quat=_numbers(quaternion[[3, 0, 1, 2]]),
        fovy=f"{math.degrees(2 * math.atan(camera.height / camera.fy / 2)):.6f}",
        resolution=f"{camera.width} {camera.height}",
    )
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    note = f"{len(tiles)} convex tiles of the scene; what is less than 4 cm over the floor is the plane"
    return ExportedFiles({f"{request.stem}{request.suffix}": text}, (note,) if request.scene else ())


def _person(
    asset: ElementTree.Element,
    world: ElementTree.Element,
    name: str,
    person: Person,
    model: BodyModel,
    matrix: NDArray[np.float64],
) -> None:
    """Add a mocap body with a visual mesh and one convex collision mesh for each body part."""
    if model.num_vertices != len(person.vertices):
        raise InputError(f"{name} has {len(person.vertices)} vertices, but the body model has {model.num_vertices}")
    pelvis = transform_points(matrix, person.joints[0])
    vertices = transform_points(matrix, person.vertices) - pelvis
    body = ElementTree.SubElement(world, "body", name=name, mocap="true", pos=_numbers(pelvis))
    _mesh(asset, name, vertices, model.faces.numpy())
    skin = ElementTree.SubElement(body, "geom", name=f"{name}_skin", type="mesh", mesh=name, rgba=_SKIN)
    skin.attrib.update(contype="0", conaffinity="0", group="2", mass="0")
    parts = model.part_of_vertex.numpy()
    for number, part in enumerate(model.part_names):
        own = f"{name}_{part}"
        _mesh(asset, own, *_hull(vertices[parts == number]))
        shape = ElementTree.SubElement(body, "geom", name=own, type="mesh", mesh=own, rgba=_SKIN)
        shape.attrib.update(friction=_FRICTION, group="3")


def _hull(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    import trimesh

    hull = trimesh.convex.convex_hull(points)
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def _mesh(
    asset: ElementTree.Element, name: str, vertices: NDArray[np.float64], faces: NDArray[np.integer[Any]]
) -> None:
    """Add a mesh whose numbers are in the file itself."""
    indices = " ".join(map(str, faces.reshape(-1).tolist()))
    ElementTree.SubElement(asset, "mesh", name=name, vertex=_numbers(vertices.reshape(-1), 4), face=indices)


def _numbers(values: Iterable[float], digits: int = 6) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
