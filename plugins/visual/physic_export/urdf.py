"""URDF: each person as a robot with revolute joints, the pose of the photo beside it, and the
scene; metres.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh
from trimesh.exchange.obj import export_obj

from physic_core import ExportedFiles, ExportRequest
from physic_core.geometry import rotmat_to_euler, rotmat_to_quat, transform_points
from physic_export.balance import people_of, tiles_beside
from physic_export.humanoid import SOLE_RADIUS_M, body_segments, inertia_of, max_torque
from physic_export.meshes import scene_mesh
from physic_export.mjcf import number_text, xml_file
from physic_export.tiles import overlapping_segments

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.types import Float64Array
    from physic_export.humanoid import Capsule, Mesh, Segment
    from physic_export.tiles import Tile


_FASTEST_RAD_S = 30.0
"""Largest speed of a joint, which the format demands: about that of a knee that kicks a ball."""

_MESHES = "meshes"
"""Folder of all meshes."""

_GROUND_M = (100.0, 100.0, 1.0)
"""Sides of the box whose upper face is the floor: the format has no planes."""

_SMALL_KG = 0.01
_SMALL_KG_M2 = 1e-4
"""Mass and moment of inertia of the links between the axes of one joint, which simulators do not
allow to be 0.
"""


@dataclass
class _Robot:
    """A URDF file while it is written.

    Attributes:
        stem: of the file.
        root: element "robot".
        meshes: file name -> content.
    """

    stem: str
    root: Element
    meshes: dict[str, bytes] = field(default_factory=dict)

    def add_mesh(self, name: str, mesh: Mesh) -> Element:
        """Add a mesh file, and return the geometry that shows it."""
        # Drake reads no STL.
        file = f"{_MESHES}/{self.stem}_{name}.obj"
        shape = trimesh.Trimesh(*mesh, process=False)
        self.meshes[file] = export_obj(
            shape, include_normals=False, include_color=False, header=None, digits=6
        ).encode()
        geometry = Element("geometry")
        SubElement(geometry, "mesh", filename=file)
        return geometry


def export_urdf(request: ExportRequest) -> ExportedFiles:
    """Return a URDF file per person, a JSON file with the pose of the photo, an SRDF file with the
    links that do not collide, the scene, and the meshes of all.

    The robot has the 22 segments and 51 hinges of :mod:`physic_export.humanoid`; the link
    ``pelvis`` is the root. All joints at 0 are a T-pose. A joint with several axes is several
    revolute joints with light links between them. The JSON file has ``base``, the place of the
    pelvis in the frame of the export, and ``joints``, the angle of each joint in radians.
    ``robot_scene.urdf`` is in the frame of the export: the surface of the scene, and what collides,
    its convex tiles and a box under the floor.
    """
    files: dict[str, bytes] = {}
    people = people_of(request)
    for person in people:
        segments = body_segments(person.rig, person.vertices, person.ground_heights)
        name = request.file_of(person.index)
        stem = PurePath(name).stem
        robot = _build_robot(stem, f"person_{person.index}", segments)
        files |= robot.meshes
        files[f"{stem}.json"] = (
            json.dumps(_srdf_pose(request, segments), indent=2) + "\n"
        ).encode()
        files[f"{stem}.srdf"] = xml_file(_pairs(robot.root.attrib["name"], segments))
        files[name] = xml_file(robot.root)
    notes = [person.note for person in people if person.note]
    if request.scene:
        tiles, left_out = tiles_beside(request, people)
        files |= _scene_files(request, tiles)
        notes += left_out
    return ExportedFiles(files, tuple(notes))


def _scene_files(request: ExportRequest, tiles: Sequence[Tile]) -> dict[str, bytes]:
    """Return the scene as a robot of one link, and its meshes."""
    stem = f"{request.stem}_scene"
    robot = _Robot(stem, _robot_root("scene", collides=True))
    link = SubElement(robot.root, "link", name="scene")
    if (surface := scene_mesh(request)) is not None:
        SubElement(link, "visual").append(
            robot.add_mesh("surface", (surface.vertices, surface.faces))
        )
    for number, tile in enumerate(tiles):
        mesh = transform_points(request.frame.from_camera, tile.vertices), tile.faces
        SubElement(link, "collision").append(robot.add_mesh(f"tile_{number}", mesh))
    if request.result.scene.floor is not None:
        below = np.eye(4)
        below[2, 3] = -_GROUND_M[2] / 2
        _add_collision(link, below, "box", size=number_text(_GROUND_M, 0))
    return {**robot.meshes, f"{stem}.urdf": xml_file(robot.root)}


def _robot_root(name: str, collides: bool) -> Element:
    """Return a robot without links; in MuJoCo, its links collide or do not."""
    root = Element("robot", name=name)
    # For MuJoCo, which otherwise looks for meshes beside the file, and melts the root into the
    # world.
    mujoco = SubElement(root, "mujoco")
    SubElement(mujoco, "compiler", strippath="false", fusestatic="false")
    if not collides:
        SubElement(SubElement(mujoco, "option"), "flag", contact="disable")
    return root


def _pairs(name: str, segments: Sequence[Segment]) -> Element:
    """Return the pairs of links whose collisions a planner skips: neighbors, which light links
    separate in the file, and those that meet in the pose or in the T-pose.
    """
    root = Element("robot", name=name)
    neighbors = [(one.parent, number) for number, one in enumerate(segments) if one.parent >= 0]
    for reason, pairs in (("Adjacent", neighbors), ("Default", overlapping_segments(segments))):
        for first, second in pairs:
            links = {"link1": segments[first].name, "link2": segments[second].name}
            SubElement(root, "disable_collisions", links, reason=reason)
    return root


def _srdf_pose(request: ExportRequest, segments: Sequence[Segment]) -> dict[str, object]:
    place = segments[0].pose
    quaternion = rotmat_to_quat(place[:3, :3]).tolist()
    return {
        "frame": request.frame.axes,
        "base": {
            "position_m": [round(value, 6) for value in place[:3, 3].tolist()],
            "quaternion_wxyz": [round(value, 8) for value in (quaternion[3], *quaternion[:3])],
        },
        "joints": {
            f"{segment.name}_{hinge.axis}": round(hinge.angle, 6)
            for segment in segments
            for hinge in segment.hinges
        },
    }


def _build_robot(stem: str, name: str, segments: Sequence[Segment]) -> _Robot:
    # MuJoCo would push segments apart that only a light link between two axes separates.
    robot = _Robot(stem, _robot_root(name, collides=False))
    mass = sum(one.mass for one in segments)
    for segment in segments:
        parent_name = segments[segment.parent].name
        pose = segment.zero_pose
        for number, hinge in enumerate(segment.hinges, 1):
            joint = SubElement(
                robot.root, "joint", name=f"{segment.name}_{hinge.axis}", type="revolute"
            )
            below = (
                segment.name
                if number == len(segment.hinges)
                else f"{segment.name}_after_{hinge.axis}"
            )
            SubElement(joint, "parent", link=parent_name)
            SubElement(joint, "child", link=below)
            SubElement(joint, "origin", _urdf_origin(pose))
            SubElement(joint, "axis", xyz=number_text(hinge.axis_at_rest, 8))
            limits = {
                "lower": f"{hinge.low:.6f}",
                "upper": f"{hinge.high:.6f}",
                "velocity": f"{_FASTEST_RAD_S:g}",
            }
            SubElement(joint, "limit", limits, effort=f"{max_torque(segment.name, mass):.3f}")
            if below != segment.name:
                link = SubElement(robot.root, "link", name=below)
                _add_inertia(link, _SMALL_KG, np.zeros(3), np.eye(3) * _SMALL_KG_M2)
            parent_name = below
            pose = np.eye(4)
        _add_link(robot, segment)
    return robot


def _add_link(robot: _Robot, segment: Segment) -> None:
    link = SubElement(robot.root, "link", name=segment.name)
    _add_inertia(link, segment.mass, *inertia_of(segment.hull, segment.mass))
    SubElement(link, "visual").append(robot.add_mesh(f"{segment.name}_skin", segment.skin))
    if segment.capsule is not None:
        _add_capsule(link, segment.capsule)
    else:
        SubElement(link, "collision").append(robot.add_mesh(segment.name, segment.hull))
    for point in segment.soles:
        _add_sphere(link, point, SOLE_RADIUS_M)


def _add_capsule(link: Element, capsule: Capsule) -> None:
    """Add a cylinder and two spheres: the format has no capsules."""
    along = capsule.ends[1] - capsule.ends[0]
    length = float(np.linalg.norm(along))
    place = trimesh.geometry.align_vectors((0.0, 0.0, 1.0), along)
    place[:3, 3] = capsule.ends.mean(0)
    _add_collision(link, place, "cylinder", radius=f"{capsule.radius:.5f}", length=f"{length:.5f}")
    for end in capsule.ends:
        _add_sphere(link, end, capsule.radius)


def _add_sphere(link: Element, center: Float64Array, radius: float) -> None:
    place = np.eye(4)
    place[:3, 3] = center
    _add_collision(link, place, "sphere", radius=f"{radius:.5f}")


def _add_collision(link: Element, place: Float64Array, shape: str, **sizes: str) -> None:
    collision = SubElement(link, "collision")
    SubElement(collision, "origin", _urdf_origin(place))
    SubElement(SubElement(collision, "geometry"), shape, sizes)


def _add_inertia(link: Element, mass: float, center: Float64Array, inertia: Float64Array) -> None:
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=number_text(center), rpy="0 0 0")
    SubElement(inertial, "mass", value=f"{mass:.4f}")
    names = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
    SubElement(
        inertial, "inertia", {f"i{name}": f"{inertia[at]:.8f}" for name, at in names.items()}
    )


def _urdf_origin(place: Float64Array) -> dict[str, str]:
    """Return position and fixed-axis angles (roll, pitch, yaw) of a pose (4, 4)."""
    angles = rotmat_to_euler("xyz", place[:3, :3])
    return {"xyz": number_text(place[:3, 3]), "rpy": number_text(angles.tolist(), 8)}
