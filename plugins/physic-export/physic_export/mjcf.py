"""MJCF: the scene as closed convex meshes, the floor as a plane, people with joints; metres, z up."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import roma
import torch

from physic_core import ExportedFiles, ExportRequest
from physic_core.errors import InputError
from physic_core.geometry.upright import transform_points
from physic_core.visual.export.request import camera_pose
from physic_core.visual.rig import body_of_result, rigs
from physic_export.humanoid import add_defaults, add_humanoid
from physic_export.mjcf_shapes import FRICTION, RGBA, add_mesh, convex_hull, numbers
from physic_export.tiles import Tile, convex_tiles, tile_errors

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Person

_PERSON_BITS = 29
"""Number of people who collide with one another, but not with themselves: MuJoCo has 32 bits; one is the scene's."""


def export_mjcf(request: ExportRequest) -> ExportedFiles:
    """Return one MJCF file without other files.

    - ``floor``: an infinite plane at z = 0; gravity is -9.81 m/s2 along z.
    - ``scene_0``, ...: the scene above the floor, as closed convex tiles of 0.1 m thickness.
    - ``person_0``, ...: 22 bodies with joints, see :mod:`physic_export.humanoid`. With the option ``rigid``, a mocap
      body at the pelvis. Visual meshes are in group 2, the shapes that collide in group 3.
    - camera ``photo``: that of the photo.
    """
    tiles = convex_tiles(request.result) if request.scene else []
    text = mjcf_text(request, tiles, () if request.options["rigid"] else request.people)
    if not request.scene:
        return ExportedFiles({f"{request.stem}{request.suffix}": text})
    note = f"{len(tiles)} convex tiles of the scene; what is less than 4 cm over the floor is the plane"
    errors = tile_errors(request.result, tiles)
    if errors is not None:
        note += f"; from the scene to the tiles: {100 * errors[0]:.1f} cm (median), {100 * errors[1]:.1f} cm (95 %)"
    return ExportedFiles({f"{request.stem}{request.suffix}": text}, (note,))


def mjcf_text(request: ExportRequest, tiles: Sequence[Tile], jointed: Collection[int]) -> bytes:
    """Return the MJCF file of a request.

    Args:
        request: with z up.
        tiles: of the scene.
        jointed: the people of the request who have joints; the others are rigid.
    """
    result, matrix = request.result, request.frame.from_camera
    root = ElementTree.Element("mujoco", model="physic")
    root.append(ElementTree.Comment(f" PhySIC; metres; {request.frame.axes} "))
    ElementTree.SubElement(root, "compiler", angle="radian")
    ElementTree.SubElement(root, "option", gravity="0 0 -9.81", timestep="0.002", integrator="implicitfast")
    visual = ElementTree.SubElement(root, "visual")
    camera = result.intrinsics
    ElementTree.SubElement(visual, "global", offwidth=str(camera.width), offheight=str(camera.height))
    ElementTree.SubElement(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.6 0.6 0.6", specular="0 0 0")
    ElementTree.SubElement(visual, "map", znear="0.01")
    asset, world = ElementTree.SubElement(root, "asset"), ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(
        world, "geom", name="floor", type="plane", size="0 0 1", rgba="0.55 0.58 0.55 1", friction=FRICTION
    )
    for number, tile in enumerate(tiles):
        name = f"scene_{number}"
        add_mesh(asset, name, transform_points(matrix, tile.vertices), tile.faces)
        rgba = " ".join(f"{v:.3f}" for v in [*tile.color, 1.0])
        ElementTree.SubElement(world, "geom", name=name, type="mesh", mesh=name, rgba=rgba, friction=FRICTION)
    if rigid := [index for index in request.people if index not in jointed]:
        model = body_of_result(result, request.body_file)
        for index in rigid:
            _person(asset, world, f"person_{index}", result.people[index], model, matrix)
    if jointed:
        add_defaults(root)
    for index, rig in rigs(replace(request, people=tuple(jointed))):
        bit = 2 << index % _PERSON_BITS
        geom = {"contype": str(bit), "conaffinity": str(2**31 - 1 - bit), "group": "3"}
        geom |= {"friction": FRICTION, "rgba": RGBA}
        vertices = transform_points(matrix, result.people[index].vertices)
        add_humanoid(asset, world, f"person_{index}", rig, vertices, geom)
    pose = camera_pose(request.frame)
    quaternion = roma.rotmat_to_unitquat(torch.from_numpy(pose[:3, :3].copy())).numpy()
    ElementTree.SubElement(
        world,
        "camera",
        name="photo",
        pos=numbers(pose[:3, 3]),
        quat=numbers(quaternion[[3, 0, 1, 2]]),
        fovy=f"{math.degrees(2 * math.atan(camera.height / camera.fy / 2)):.6f}",
        resolution=f"{camera.width} {camera.height}",
    )
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


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
    body = ElementTree.SubElement(world, "body", name=name, mocap="true", pos=numbers(pelvis))
    add_mesh(asset, name, vertices, model.faces.numpy())
    skin = ElementTree.SubElement(body, "geom", name=f"{name}_skin", type="mesh", mesh=name, rgba=RGBA)
    skin.attrib.update(contype="0", conaffinity="0", group="2", mass="0")
    parts = model.part_of_vertex.numpy()
    for number, part in enumerate(model.part_names):
        own = f"{name}_{part}"
        add_mesh(asset, own, *convex_hull(vertices[parts == number]))
        shape = ElementTree.SubElement(body, "geom", name=own, type="mesh", mesh=own, rgba=RGBA)
        shape.attrib.update(friction=FRICTION, group="3")
