"""People of MJCF files with joints: bodies, hinges and position actuators."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree

import roma
import torch

from physic_export.humanoid import SOLE_RADIUS_M, Segment
from physic_export.joint_strength import FULL_TORQUE_RAD, RESPONSE_S, max_torque
from physic_export.mjcf_shapes import RGBA, add_mesh, numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_export.humanoid import Hinge


_ARMATURE = 0.05  # kg m2, keeps the small bodies stable


def add_defaults(root: ElementTree.Element) -> None:
    """Add what all hinges have."""
    defaults = ElementTree.SubElement(root, "default")
    ElementTree.SubElement(defaults, "joint", armature=f"{_ARMATURE:g}")


def add_humanoid(root: ElementTree.Element, name: str, segments: Sequence[Segment], geom: dict[str, str]) -> None:
    """Add a person with joints, in their pose.

    Args:
        root: of the file, with "asset", "worldbody" and "actuator".
        name: such as "person_0"; bodies are "person_0" (the pelvis), "person_0_left_hip", ...
        segments: of the person.
        geom: attributes of the shapes that collide.
    """
    asset, world, actuators = (root.find(tag) for tag in ("asset", "worldbody", "actuator"))
    assert asset is not None
    assert world is not None
    assert actuators is not None
    mass = sum(one.mass for one in segments)
    bodies: list[ElementTree.Element] = []
    for segment in segments:
        own = name if segment.parent < 0 else f"{name}_{segment.name}"
        quaternion = roma.rotmat_to_unitquat(torch.from_numpy(segment.pose[:3, :3].copy())).numpy()[[3, 0, 1, 2]]
        above = world if segment.parent < 0 else bodies[segment.parent]
        place = {"pos": numbers(segment.pose[:3, 3]), "quat": numbers(quaternion, 8)}
        body = ElementTree.SubElement(above, "body", {"name": own} | place)
        bodies.append(body)
        if segment.parent < 0:
            ElementTree.SubElement(body, "freejoint", name=f"{name}_root")
        for hinge in segment.hinges:
            _add_hinge(body, f"{own}_{hinge.axis}", hinge)
            _add_actuator(actuators, f"{own}_{hinge.axis}", max_torque(segment.name, mass))
        add_mesh(asset, f"{own}_skin", *segment.skin)
        skin = {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0", "rgba": RGBA}
        ElementTree.SubElement(body, "geom", {"name": f"{own}_skin", "type": "mesh", "mesh": f"{own}_skin"} | skin)
        _add_shapes(asset, body, own, segment, geom)


def add_photo_key(root: ElementTree.Element) -> None:
    """Add the keyframe "photo": the pose of the photo, and the controls that hold it."""
    places, angles = [], {}
    for body in root.iter("body"):
        for joint in body:
            if joint.tag == "freejoint":
                places += [body.attrib["pos"], body.attrib["quat"]]
            elif joint.tag == "joint":
                places.append(joint.attrib["ref"])
                angles[joint.attrib["name"]] = joint.attrib["ref"]
    controls = [angles[one.attrib["joint"]] for one in root.iter("position")]
    key = ElementTree.SubElement(root, "keyframe")
    ElementTree.SubElement(key, "key", name="photo", qpos=" ".join(places), ctrl=" ".join(controls))


def _add_hinge(body: ElementTree.Element, name: str, hinge: Hinge) -> None:
    shared = {"name": name, "axis": numbers(hinge.posed, 8), "ref": f"{hinge.angle:.6f}"}
    shared["range"] = numbers((hinge.low, hinge.high))
    ElementTree.SubElement(body, "joint", shared)


def _add_actuator(actuators: ElementTree.Element, joint: str, torque: float) -> None:
    stiffness = torque / FULL_TORQUE_RAD
    ElementTree.SubElement(
        actuators,
        "position",
        name=joint,
        joint=joint,
        kp=f"{stiffness:.2f}",
        kv=f"{stiffness * RESPONSE_S:.3f}",
        forcerange=numbers((-torque, torque), 3),
        inheritrange="1",
    )


def _add_shapes(
    asset: ElementTree.Element, body: ElementTree.Element, name: str, segment: Segment, geom: dict[str, str]
) -> None:
    """Add what collides: a capsule or the hull, which has the mass, and the soles."""
    if segment.capsule is not None:
        capsule = segment.capsule
        shapes = [{"type": "capsule", "fromto": numbers(capsule.ends.ravel()), "size": f"{capsule.radius:.5f}"}]
    else:
        add_mesh(asset, name, *segment.hull)
        shapes = [{"type": "mesh", "mesh": name}]
    shapes += [{"type": "sphere", "pos": numbers(point), "size": f"{SOLE_RADIUS_M:g}"} for point in segment.soles]
    for number, shape in enumerate(shapes):
        own = {"name": f"{name}_{number}", "mass": "0"} if number else {"name": name}
        ElementTree.SubElement(body, "geom", {"mass": f"{segment.mass:.4f}"} | own | shape | geom)
