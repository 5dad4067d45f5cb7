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
"""Classes of joints: of trunk, legs and head; of arms. They make the body nearly a statue, so that a body that falls
is out of balance; with ten times the stiffness, the same bodies of worlds stay. No passive person stands: the stiffness
of human ankles in quiet standing is 91 % of the load's (Loram and Lakie, J. Physiol. 545.3, 2002), and muscles do the
rest."""

_ARMATURE = 0.05  # kg m2, keeps the small bodies stable

_FLAT_M, _SOLE_RADIUS_M, _SOLE_POINTS = 0.02, 0.005, 8
"""Height over the lowest point up to which skin flattens on the floor, which is the distance of contact of the
reconstruction; radius of the spheres at the outline of what is flat, and their number."""

_FOOT = {"ankle": "foot", "foot": "ankle"}

_CHILD_OF_LIMB = {"shoulder": "elbow", "elbow": "wrist"}
"""Segments that collide as capsules, and the joint at their other end. A thigh tapers: its capsule would be up to 5 cm
off its skin, and people sit on thighs."""


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
        vertices: (V, 3) posed, in that frame, with the floor at z = 0.
        geom: attributes of the shapes that collide.
    """
    poses, part = rig.world(), segments(rig.weights)
    hulls = [convex_hull(vertices[part == joint]) for joint in range(NUM_BODIES)]
    volumes = np.array([_volume(*hull) for hull in hulls])
    masses = DENSITY_KG_M3 * _volume(vertices, rig.faces) * volumes / volumes.sum()
    lowest = [float(vertices[part == joint, 2].min()) for joint in range(NUM_BODIES)]
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
        shapes = _capsule(label, local[part == joint], poses, joint)
        if not shapes:
            add_mesh(asset, own_name, (hulls[joint][0] - poses[joint][:3, 3]) @ poses[joint][:3, :3], hulls[joint][1])
            shapes = [{"type": "mesh", "mesh": own_name}]
        if label.endswith(("ankle", "foot")) or lowest[joint] < _FLAT_M:
            side, _, plain = label.rpartition("_")
            other = lowest[JOINT_INDEX[f"{side}_{_FOOT[plain]}"]] if plain in _FOOT else lowest[joint]
            drop = lowest[joint] - other  # heel and ball of a foot have one sole
            shapes += _soles(local[part == joint], poses[joint][2, :3], drop if 0 < drop < _FLAT_M else 0.0)
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


def _capsule(label: str, points: Array, poses: Array, joint: int) -> list[dict[str, str]]:
    """Return the capsule of an arm's points in its frame; none for other parts of the body."""
    side, _, plain = label.rpartition("_")
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


def _soles(points: Array, up: Array, drop: float) -> list[dict[str, str]]:
    """Return spheres at the outline of the lowest skin of a part of the body, on one level, as under a shoe.

    MuJoCo finds three neighbouring points of a mesh on a plane, too few to stand on; and a bare sole, which is round,
    flattens under the body's weight. The level is that of the pose, not of the joint: a heel that is 1 cm over the
    floor would otherwise let a balanced body rock by 8 degrees, and fall.

    Args:
        points: (V, 3) in the frame of the part.
        up: (3,) the vertical in that frame, in the pose of the file.
        drop: depth of the level under the lowest point.
    """
    from scipy.spatial import ConvexHull

    height = points @ up
    sole = height < height.min() + _FLAT_M
    if sole.sum() < 8:
        sole = np.argsort(height)[:8]
    level = points[sole] - (height[sole] - height.min() + drop - _SOLE_RADIUS_M)[:, None] * up
    flat = level @ np.linalg.svd(up[None])[2][1:].T
    outline = level[ConvexHull(flat).vertices]
    kept = [0]
    while len(kept) < min(_SOLE_POINTS, len(outline)):
        apart = np.linalg.norm(outline[:, None] - outline[kept], axis=2).min(1)
        kept.append(int(apart.argmax()))
    return [{"type": "sphere", "pos": numbers(point), "size": f"{_SOLE_RADIUS_M:g}"} for point in outline[kept]]


def _volume(vertices: Array, faces: NDArray[np.int64]) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.abs((a * np.cross(b, c)).sum() / 6))
