"""MJCF: the scene as a textured mesh and as convex meshes that collide, and people with joints;
metres, z up.

Each joint of a person is a chain of hinges with position actuators.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
import trimesh

from physic_core import ExportedFiles, ExportRequest
from physic_core.body import JOINT_NAMES, PART_NAMES
from physic_core.errors import InputError
from physic_core.export import camera_pose
from physic_core.geometry import rotmat_to_quat, transform_points
from physic_export.balance import ExportedPerson, people_of, tiles_beside
from physic_export.humanoid import (
    DENSITY_KG_M3,
    FULL_TORQUE_RAD,
    NUM_BODIES,
    RESPONSE_S,
    SOLE_RADIUS_M,
    Segment,
    body_segments,
    convex_hull,
    inertia_of,
    max_torque,
    vertex_segments,
)
from physic_export.meshes import scene_mesh
from physic_export.tiles import Tile, overlapping_bodies, overlapping_segments
from physic_visual.floor import floor_rectangles
from physic_visual.rig import body_of_result
from physic_visual.scene_mesh import mesh_scene, scene_reach
from physic_visual.textures.photo import encode_image

if TYPE_CHECKING:
    from physic_core.body import BodyArrays
    from physic_core.types import Float64Array, IntArray, Intrinsics, Person

RGBA = "0.77 0.75 0.73 1"
FRICTION = "0.8 0.005 0.0001"
"""Sliding, torsional (m) and rolling (m) friction of floor, scene and people: rubber soles on dry
ground.
"""


@dataclass(frozen=True)
class _File:
    """Elements of a file to which people and scene are added."""

    root: Element
    asset: Element
    world: Element
    actuators: Element

    def add_mesh(
        self,
        name: str,
        vertices: Float64Array,
        faces: IntArray,
        uv: Float64Array | None = None,
    ) -> dict[str, str]:
        """Add a mesh whose numbers are in the file itself, closed unless it has texture coordinates
        (V, 2), v up; return the attributes of a geom of the same name that shows it.
        """
        element = SubElement(
            self.asset, "mesh", name=name, vertex=number_text(vertices.reshape(-1), 4)
        )
        element.set("face", " ".join(map(str, faces.reshape(-1).tolist())))
        if uv is not None:
            element.set("texcoord", number_text((uv * [1, -1] + [0, 1]).reshape(-1), 5))
            element.set("inertia", "shell")  # an open surface has no volume
        return {"name": name, "type": "mesh", "mesh": name}


def number_text(values: Iterable[float], digits: int = 6) -> str:
    """Return numbers as text."""
    return " ".join(f"{value:.{digits}f}" for value in values)


def xml_file(root: Element) -> bytes:
    """Return the content of an XML file with an element and what is in it, indented."""
    indent(root)
    content: bytes = tostring(root, encoding="utf-8", xml_declaration=True)
    return content


_ARMATURE = 0.05  # kg m2, keeps the small bodies stable


def _add_humanoid(
    file: _File, name: str, segments: Sequence[Segment], geom: dict[str, str]
) -> dict[str, float]:
    """Add a person with joints, in their pose, where all hinges are 0.

    Args:
        file: to which it is added.
        name: such as "person_0"; bodies are "person_0" (the pelvis), "person_0_left_hip", ...
        segments: of the person.
        geom: attributes of the shapes that collide.

    Returns:
        Hinge -> its angle in the T-pose, radians.
    """
    mass = sum(each_segment.mass for each_segment in segments)
    bodies: list[Element] = []
    resting = {}
    for segment in segments:
        body_name = name if segment.parent < 0 else f"{name}_{segment.name}"
        quaternion = rotmat_to_quat(segment.pose[:3, :3])[[3, 0, 1, 2]]
        parent = file.world if segment.parent < 0 else bodies[segment.parent]
        pose = {"pos": number_text(segment.pose[:3, 3]), "quat": number_text(quaternion, 8)}
        body = SubElement(parent, "body", {"name": body_name} | pose)
        bodies.append(body)
        _add_inertia(body, segment.mass, *inertia_of(segment.hull, segment.mass))
        if segment.parent < 0:
            SubElement(body, "freejoint", name=f"{name}_root")
        for hinge in segment.hinges:
            joint = f"{body_name}_{hinge.axis}"
            limits = np.rad2deg([hinge.low - hinge.angle, hinge.high - hinge.angle])
            torque = max_torque(segment.name, mass)
            SubElement(
                body,
                "joint",
                name=joint,
                axis=number_text(hinge.axis_in_pose, 8),
                range=number_text(limits),
                actuatorfrcrange=number_text((-torque, torque), 3),  # which Newton reads
            )
            resting[joint] = -hinge.angle
            _add_actuator(file.actuators, joint, torque)
        skin = file.add_mesh(f"{body_name}_skin", *segment.skin)
        SubElement(body, "geom", skin | _DRAWN | {"rgba": RGBA})
        _add_shapes(file, body, body_name, segment, geom)
    return resting


def _add_t_pose(root: Element, resting: dict[str, float]) -> None:
    """Add the keyframe "t_pose" of hinge -> angle, and the controls that move people there."""
    places = []
    for body in root.iter("body"):
        for joint in body:
            if joint.tag == "freejoint":
                places += [body.attrib["pos"], body.attrib["quat"]]
            elif joint.tag == "joint":
                places.append(f"{resting[joint.attrib['name']]:.6f}")
    controls = number_text(resting[one.attrib["joint"]] for one in root.iter("position"))
    key = SubElement(root, "keyframe")
    SubElement(key, "key", name="t_pose", qpos=" ".join(places), ctrl=controls)


def _add_actuator(actuators: Element, joint: str, torque: float) -> None:
    stiffness = torque / FULL_TORQUE_RAD
    SubElement(
        actuators,
        "position",
        name=joint,
        joint=joint,
        kp=f"{stiffness:.2f}",
        kv=f"{stiffness * RESPONSE_S:.3f}",
        forcerange=number_text((-torque, torque), 3),
        inheritrange="1",
    )


def _add_shapes(
    file: _File,
    body: Element,
    name: str,
    segment: Segment,
    geom: dict[str, str],
) -> None:
    """Add what collides: a capsule or the hull, and the soles."""
    if segment.capsule is not None:
        capsule = segment.capsule
        shapes = [
            {
                "type": "capsule",
                "fromto": number_text(capsule.ends.ravel()),
                "size": f"{capsule.radius:.5f}",
            }
        ]
    else:
        shapes = [file.add_mesh(name, *segment.hull)]
    shapes += [
        {"type": "sphere", "pos": number_text(point), "size": f"{SOLE_RADIUS_M:g}"}
        for point in segment.soles
    ]
    for number, shape in enumerate(shapes):
        attributes = {"name": f"{name}_{number}" if number else name}
        SubElement(body, "geom", attributes | shape | geom)


def _add_inertia(
    body: Element,
    mass: float,
    center: Float64Array,
    inertia: Float64Array,
) -> None:
    """Add the mass of a body: readers that skip meshes in the file would leave it out."""
    moments = [inertia[at] for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    shape = {"pos": number_text(center), "fullinertia": number_text(moments, 9)}
    SubElement(body, "inertial", {"mass": f"{mass:.4f}"} | shape)


_PERSON_BITS = 29
"""Number of people who collide with one another, but not with themselves: MuJoCo has 32 bits; one
is the scene's.
"""


_MAX_VERTICES = 40_000
"""Of the scene's mesh: 5 MB of text; the picture has the detail."""

_FLOOR = "0.55 0.58 0.55 1"
_HARD = {"friction": FRICTION, "group": "3"}
_DRAWN = {"contype": "0", "conaffinity": "0", "group": "2"}


def export_mjcf(request: ExportRequest) -> ExportedFiles:
    """Return one MJCF file, and the picture of its scene.

    - ``floor``: an infinite plane at z = 0, if the result has a floor; gravity is -9.81 m/s2 along
      z.
    - ``scene``: the textured surface of the scene, and ``drawn_floor``, where it does not show the
      floor; both are drawn (group 2), and do not collide.
    - ``scene_0``, ...: the scene above the floor, as closed convex tiles of 0.1 m thickness, which
      collide (group 3).
    - ``person_0``, ...: 22 bodies with joints and position actuators, see
      :mod:`physic_export.humanoid`. With the option ``rigid``, a mocap body at the pelvis. Visual
      meshes are in group 2, the shapes that collide in group 3.
    - keyframe ``t_pose``: the T-pose at the pelvis, and its controls. All hinges and controls are 0
      in the pose of the photo.
    - camera ``photo``: that of the photo.
    """
    jointed = [] if request.options["rigid"] else people_of(request)
    tiles, left_out = tiles_beside(request, jointed) if request.scene else ([], ())
    file = _build_file(request, tiles, jointed)
    picture = _add_textured_scene(file, request)
    files = {f"{request.stem}{request.suffix}": xml_file(file.root), **picture}
    notes = tuple(person.note for person in jointed if person.note)
    if not request.scene:
        return ExportedFiles(files, notes)
    note = f"{len(tiles)} convex tiles of the scene"
    if request.result.scene.floor is not None:
        note += "; a plane replaces everything less than 4 cm over the floor"
    return ExportedFiles(files, (*notes, note, *left_out))


def _build_file(
    request: ExportRequest, tiles: Sequence[Tile], jointed: Sequence[ExportedPerson]
) -> _File:
    """Return the MJCF elements of a request, without the mesh of the scene.

    Args:
        request: with z up.
        tiles: of the scene.
        jointed: the people who have joints; the others of the request are rigid.
    """
    result = request.result
    matrix = request.frame.from_camera
    root = Element("mujoco", model="physic")
    root.append(Comment(f" PhySIC; meters; {request.frame.axes} "))
    SubElement(root, "compiler", angle="degree")
    SubElement(root, "option", gravity="0 0 -9.81", timestep="0.002", integrator="implicitfast")
    _add_visual_settings(root, result.intrinsics)
    if jointed:
        SubElement(SubElement(root, "default"), "joint", armature=f"{_ARMATURE:g}")
    world = Element("worldbody")
    file = _File(root, SubElement(root, "asset"), world, Element("actuator"))
    root.append(world)
    if jointed:
        root.append(file.actuators)
    if result.scene.floor is not None:
        SubElement(
            world, "geom", name="floor", type="plane", size="0 0 1", rgba=_FLOOR, friction=FRICTION
        )
    for number, tile in enumerate(tiles):
        _add_tile(file, f"scene_{number}", tile, matrix)
    if rigid := [index for index in request.person if index not in {one.index for one in jointed}]:
        model = body_of_result(result, request.body_file)
        for index in rigid:
            _add_rigid(file, f"person_{index}", result.people[index], model, matrix)
    _add_jointed(file, jointed)
    _add_camera(world, result.intrinsics, camera_pose(request.frame))
    return file


def _add_jointed(file: _File, jointed: Sequence[ExportedPerson]) -> None:
    """Add people who have joints, their T-pose, and which of their segments do not collide."""
    resting: dict[str, float] = {}
    contact = Element("contact")
    for person in jointed:
        bit = 2 << person.index % _PERSON_BITS
        geom = {"contype": str(bit), "conaffinity": str(2**31 - 1 - bit), "group": "3"}
        geom |= {"friction": FRICTION, "rgba": RGBA}
        segments = body_segments(person.rig, person.vertices, person.ground_heights)
        resting |= _add_humanoid(file, f"person_{person.index}", segments, geom)
        for pair in overlapping_segments(segments):
            _exclude(contact, (person.index, person.index), pair)
    if resting:
        _add_t_pose(file.root, resting)
    _exclude_touching(contact, jointed)
    if len(contact):
        file.root.append(contact)


def _add_visual_settings(root: Element, camera: Intrinsics) -> None:
    """Add the size of pictures, and the light and the near plane of views."""
    visual = SubElement(root, "visual")
    SubElement(visual, "global", offwidth=str(camera.width), offheight=str(camera.height))
    SubElement(visual, "headlight", ambient="0.4 0.4 0.4", diffuse="0.6 0.6 0.6", specular="0 0 0")
    SubElement(visual, "map", znear="0.01")


def _add_tile(file: _File, name: str, tile: Tile, matrix: Float64Array) -> None:
    """Add a collision mesh of the scene."""
    shape = file.add_mesh(name, transform_points(matrix, tile.vertices), tile.faces)
    SubElement(file.world, "geom", shape | {"rgba": number_text([*tile.color, 1.0], 3)} | _HARD)


def _add_camera(world: Element, camera: Intrinsics, pose: Float64Array) -> None:
    SubElement(
        world,
        "camera",
        name="photo",
        pos=number_text(pose[:3, 3]),
        quat=number_text(rotmat_to_quat(pose[:3, :3])[[3, 0, 1, 2]]),
        fovy=f"{math.degrees(2 * math.atan(camera.height / camera.fy / 2)):.6f}",
        resolution=f"{camera.width} {camera.height}",
    )


def _exclude(contact: Element, people: tuple[int, int], joints: tuple[int, int]) -> None:
    """Exclude collisions of two segments, each of a person."""
    names = {}
    for number, person, joint in zip((1, 2), people, joints, strict=True):
        name = f"person_{person}"
        names[f"body{number}"] = f"{name}_{JOINT_NAMES[joint]}" if joint else name
    SubElement(contact, "exclude", names)


def _exclude_touching(contact: Element, people: Sequence[ExportedPerson]) -> None:
    """Exclude collisions of parts of two people that touch in the pose: shapes that overlap push
    people over.
    """
    parts = []
    for person in people:
        part = vertex_segments(person.rig.weights)
        parts.append([person.vertices[part == joint] for joint in range(NUM_BODIES)])
    for first, second in itertools.combinations(range(len(people)), 2):
        for pair in overlapping_bodies(parts[first], parts[second]):
            _exclude(contact, (people[first].index, people[second].index), pair)


def _add_textured_scene(out: _File, request: ExportRequest) -> dict[str, bytes]:
    """Add the mesh of the scene and the floor that is drawn, and return the picture."""
    scene = scene_mesh(request, _MAX_VERTICES)
    if scene is None or scene.uv is None:
        return {}
    file = f"{request.stem}_scene.png"
    SubElement(out.asset, "texture", name="scene", type="2d", file=file)
    SubElement(out.asset, "material", name="scene", texture="scene", specular="0", shininess="0")
    shape = out.add_mesh("scene", scene.vertices, scene.faces, scene.uv)
    SubElement(out.world, "geom", shape | {"material": "scene"} | _DRAWN)
    surface = mesh_scene(request.result.scene, scene_reach(request.result), _MAX_VERTICES)
    floor = floor_rectangles(request.result, request.frame, surface)
    if floor is not None and len(floor[1]):
        shape = out.add_mesh("drawn_floor", *floor, uv=np.zeros((len(floor[0]), 2)))
        SubElement(out.world, "geom", shape | {"rgba": _FLOOR} | _DRAWN)
    for geom in out.world.iterfind("geom[@name='floor']"):
        geom.set("group", "3")  # it would be drawn in one place with the surface of the scene
    return {file: encode_image(request.result.scene.colors, "PNG")}


def _add_rigid(
    file: _File,
    name: str,
    person: Person,
    model: BodyArrays,
    matrix: Float64Array,
) -> None:
    """Add a mocap body with a visual mesh and one convex collision mesh for each body part."""
    if len(model.template) != len(person.vertices):
        raise InputError(
            f"{name} has {len(person.vertices)} vertices, but the body model has "
            f"{len(model.template)}"
        )
    pelvis = transform_points(matrix, person.joints[0])
    vertices = transform_points(matrix, person.vertices) - pelvis
    body = SubElement(file.world, "body", name=name, mocap="true", pos=number_text(pelvis))
    mass = DENSITY_KG_M3 * trimesh.Trimesh(vertices, model.faces, process=False).volume
    _add_inertia(body, mass, *inertia_of((vertices, model.faces), mass))
    skin = file.add_mesh(name, vertices, model.faces)
    SubElement(body, "geom", skin | {"name": f"{name}_skin", "rgba": RGBA} | _DRAWN)
    parts = model.part_of_vertex
    for number, part in enumerate(PART_NAMES):
        shape = file.add_mesh(f"{name}_{part}", *convex_hull(vertices[parts == number]))
        SubElement(body, "geom", shape | {"rgba": RGBA} | _HARD)
