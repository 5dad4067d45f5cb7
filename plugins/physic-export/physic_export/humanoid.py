"""People of MJCF files with joints: 22 bodies, hinges with limits, masses by volume, collision shapes.

A joint that turns about several axes is several hinges, since a ball joint of MJCF has one limit for all directions,
about the pose of the file. The angles are 0 in a T-pose; the pose of the file is ``ref``, where the springs rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np
import roma
import torch

from physic_core.body.joints import JOINT_INDEX, JOINT_NAMES, PARENTS
from physic_export.joint_limits import LIMITS
from physic_export.mjcf_shapes import RGBA, add_mesh, convex_hull, numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.visual.rig import Rig

    Array = NDArray[np.float64]

__all__ = ["DENSITY_KG_M3", "NUM_BODIES", "PASSIVE", "Passive", "add_defaults", "add_humanoid", "segments"]

NUM_BODIES = 22
"""Pelvis and the 21 joints of the body; fingers belong to the wrist, jaw and eyes to the head."""

DENSITY_KG_M3 = 1010.0
"""Density of a human body, whose volume has the lungs half filled."""


@dataclass(frozen=True)
class Passive:
    """Passive torques of the hinges of a joint.

    Attributes:
        stiffness: Nm/rad, towards the pose of the file.
        damping: Nm s/rad.
        friction: Nm, dry friction.
    """

    stiffness: float
    damping: float
    friction: float


PASSIVE = {"trunk": Passive(10_000.0, 500.0, 5.0), "arm": Passive(1000.0, 50.0, 1.0)}
"""Classes of joints: of trunk, legs and head, and of arms. Hips, knees and ankles in series then yield 1 cm where the
centre of mass is 10 cm from the ankles: the body is nearly a statue, and what falls is out of balance."""

_ARMATURE = 0.05  # kg m2, keeps the small bodies stable

_SOLE_M, _SOLE_RADIUS_M, _SOLE_POINTS = 0.02, 0.005, 8
"""Height of the sole over its lowest point, radius of the spheres at its outline, and their number."""

_CHILD_OF_LIMB = {"hip": "knee", "knee": "ankle", "shoulder": "elbow", "elbow": "wrist"}
"""Segments that collide as capsules, and the joint at their other end."""


def add_defaults(root: ElementTree.Element) -> None:
    """Add the passive torques as classes, where a user can change them for all people."""
    defaults = ElementTree.SubElement(root, "default")
    for name, passive in PASSIVE.items():
        own = ElementTree.SubElement(defaults, "default", {"class": name})
        ElementTree.SubElement(
            own,
            "joint",
            stiffness=f"{passive.stiffness:g}",
            damping=f"{passive.damping:g}",
            frictionloss=f"{passive.friction:g}",
            armature=f"{_ARMATURE:g}",
        )


def segments(weights: Array) -> NDArray[np.int64]:
    """Return the body (V,) in 0-21 that each vertex moves with, of skinning weights (V, 55)."""
    merged = np.zeros((len(weights), NUM_BODIES))
    for joint in range(weights.shape[1]):
        above = joint
        while above >= NUM_BODIES:
            above = PARENTS[above]
        merged[:, above] += weights[:, joint]
    body: NDArray[np.int64] = merged.argmax(1)
    return body


def add_humanoid(
    asset: ElementTree.Element,
    world: ElementTree.Element,
    name: str,
    rig: Rig,
    vertices: Array,
    geom: dict[str, str],
) -> None:
    """Add a person with joints, in their pose.

    Args:
        asset: gets the meshes.
        world: gets the body.
        name: such as "person_0"; bodies are "person_0" (the pelvis), "person_0_left_hip", ...
        rig: in the frame of the file.
        vertices: (V, 3) posed, in that frame.
        geom: attributes of the shapes that collide.
    """
    poses, part = rig.world(), segments(rig.weights)
    hulls = [convex_hull(vertices[part == joint]) for joint in range(NUM_BODIES)]
    volumes = np.array([_volume(*hull) for hull in hulls])
    masses = DENSITY_KG_M3 * _volume(vertices, rig.faces) * volumes / volumes.sum()
    bodies: list[ElementTree.Element] = []
    for joint in range(NUM_BODIES):
        parent, label = PARENTS[joint], JOINT_NAMES[joint]
        own_name = name if parent < 0 else f"{name}_{label}"
        place = poses[joint] if parent < 0 else np.linalg.inv(poses[parent]) @ poses[joint]
        quaternion = roma.rotmat_to_unitquat(torch.from_numpy(place[:3, :3].copy())).numpy()[[3, 0, 1, 2]]
        body = ElementTree.SubElement(
            world if parent < 0 else bodies[parent],
            "body",
            name=own_name,
            pos=numbers(place[:3, 3]),
            quat=numbers(quaternion, 8),
        )
        bodies.append(body)
        if parent < 0:
            ElementTree.SubElement(body, "freejoint", name=f"{name}_root")
        else:
            _add_hinges(body, own_name, label, rig.rotations[joint])
        local = (vertices - poses[joint][:3, 3]) @ poses[joint][:3, :3]
        owner = part[rig.faces]
        shown = rig.faces[np.where(owner[:, 1] == owner[:, 2], owner[:, 1], owner[:, 0]) == joint]
        used, faces = np.unique(shown, return_inverse=True)
        add_mesh(asset, f"{own_name}_skin", local[used], faces.reshape(-1, 3))
        skin = {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0", "rgba": RGBA}
        ElementTree.SubElement(
            body, "geom", {"name": f"{own_name}_skin", "type": "mesh", "mesh": f"{own_name}_skin"} | skin
        )
        shapes = _shapes(label, local[part == joint], poses, joint)
        if not shapes or shapes[0]["type"] == "sphere":
            add_mesh(asset, own_name, (hulls[joint][0] - poses[joint][:3, 3]) @ poses[joint][:3, :3], hulls[joint][1])
            shapes = [{"type": "mesh", "mesh": own_name}, *shapes]
        for number, shape in enumerate(shapes):
            own = {"name": f"{own_name}_{number}", "mass": "0"} if number else {"name": own_name}
            ElementTree.SubElement(body, "geom", {"mass": f"{masses[joint]:.4f}"} | own | shape | geom)


def _add_hinges(body: ElementTree.Element, name: str, label: str, rotation: Array) -> None:
    """Add the hinges of a joint whose rotation (3, 3) against the T-pose is that of the pose."""
    side, _, plain = label.rpartition("_")
    hinges = LIMITS[plain]
    order = "".join(axis for axis, _, _ in hinges)
    order += "".join(axis for axis in "zyx" if axis not in order)
    angles = roma.rotmat_to_euler(order.upper(), torch.from_numpy(rotation.copy())).numpy()
    turns = roma.euler_to_rotmat
    for place, (axis, low, high) in enumerate(hinges):
        # MJCF states the axis in the frame of the child, after the turns of the hinges that follow.
        after = np.eye(3)
        if order[place + 1 :]:
            after = turns(order[place + 1 :].upper(), torch.from_numpy(angles[place + 1 :])).numpy()
        direction = after.T @ np.eye(3)["xyz".index(axis)]
        bounds = np.deg2rad([low, high])
        if side == "right" and axis != "x":
            bounds = -bounds[::-1]
        angle = float(angles[place])
        bounds = np.array([min(bounds[0], angle), max(bounds[1], angle)])
        ElementTree.SubElement(
            body,
            "joint",
            {
                "name": f"{name}_{axis}",
                "class": "arm" if plain in ("collar", "shoulder", "elbow", "wrist") else "trunk",
                "axis": numbers(direction, 8),
                "ref": f"{angle:.6f}",
                "springref": f"{angle:.6f}",
                "range": numbers((bounds[0] - 1e-6, bounds[1] + 1e-6)),
            },
        )


def _shapes(label: str, points: Array, poses: Array, joint: int) -> list[dict[str, str]]:
    """Return the capsule of a limb's points in its frame, the spheres of a foot's; none for other parts of the body."""
    side, _, plain = label.rpartition("_")
    if plain in ("ankle", "foot"):
        return _soles(points)
    if plain not in _CHILD_OF_LIMB:
        return []
    child = JOINT_INDEX[f"{side}_{_CHILD_OF_LIMB[plain]}"]
    end = (poses[child][:3, 3] - poses[joint][:3, 3]) @ poses[joint][:3, :3]
    axis = end / np.linalg.norm(end)
    center = points.mean(0)
    center = center - (center @ axis) * axis
    along = points @ axis
    radius = float(np.median(np.linalg.norm(points - center - along[:, None] * axis, axis=1)))
    low, high = np.quantile(along, [0.02, 0.98])
    half = max(float(high - low) / 2 - radius, 1e-3)
    ends = np.array([-half, half]) + (low + high) / 2
    return [{"type": "capsule", "fromto": numbers((center + ends[:, None] * axis).ravel()), "size": f"{radius:.5f}"}]


def _soles(points: Array) -> list[dict[str, str]]:
    """Return spheres at the outline of the sole of a part of the foot, on one level as under a shoe.

    MuJoCo finds three neighbouring points of a mesh on a plane, too few to stand on; and a bare sole, which is round,
    flattens under the body's weight.
    """
    from scipy.spatial import ConvexHull

    sole = points[points[:, 1] < points[:, 1].min() + _SOLE_M]
    sole = points[np.argsort(points[:, 1])[:8]] if len(sole) < 8 else sole
    outline = sole[ConvexHull(sole[:, [0, 2]]).vertices]
    kept = [0]
    while len(kept) < min(_SOLE_POINTS, len(outline)):
        apart = np.linalg.norm(outline[:, None] - outline[kept], axis=2).min(1)
        kept.append(int(apart.argmax()))
    level = points[:, 1].min() + _SOLE_RADIUS_M
    return [
        {"type": "sphere", "pos": numbers((x, level, z)), "size": f"{_SOLE_RADIUS_M:g}"} for x, _, z in outline[kept]
    ]


def _volume(vertices: Array, faces: NDArray[np.int64]) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.abs((a * np.cross(b, c)).sum() / 6))
