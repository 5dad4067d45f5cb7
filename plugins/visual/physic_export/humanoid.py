"""People as rigid segments with hinges, which MJCF and URDF files share: masses by volume, limits,
collision shapes.

There are 22 segments. A joint that turns about several axes is several hinges, since a ball joint
of MJCF has one limit for all directions, about the pose of the file, and URDF has no ball joints.
The angles are 0 in a T-pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from physic_core.body import JOINT_INDEX, JOINT_NAMES, PARENTS
from physic_core.geometry import rotmat_to_euler

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from physic_core.types import Float64Array, Int64Array
    from physic_visual.rig import Rig

    Mesh = tuple[Float64Array, Int64Array]

STRENGTH_NM_PER_KG: dict[str, float] = {
    "hip": 200 / 45,
    "knee": 150 / 45,
    "ankle": 90 / 45,
    "foot": 0.3,
    "spine1": 200 / 45,
    "spine2": 200 / 45,
    "spine3": 200 / 45,
    "neck": 50 / 45,
    "head": 50 / 45,
    "collar": 100 / 45,
    "shoulder": 100 / 45,
    "elbow": 60 / 45,
    "wrist": 0.3,
}
"""Largest torque of each hinge of a joint.

The source has no toes, and rigid wrists: theirs, about 20 Nm of an adult, carry the forefoot of a
person who stands, and 10 kg in a hand. The collar bone carries the arm, and has its torque.

Source: the torque limits and the ratio of the gains of the humanoid of X. B. Peng et al.,
DeepMimic, ACM Trans. Graph. 37.4 (2018), data/characters/humanoid3d.txt and
data/controllers/humanoid3d_ctrl.txt of its code. That body has 45 kg; a torque is its share of the
mass here.
"""

FULL_TORQUE_RAD = 0.02
"""Error of the angle at which an actuator gives its whole torque: a pose that it has the strength
for is held within 1 degree. Softer ankles, as the source's with 0.2 to 0.4 rad, yield until the
mass is beside the soles.
"""

RESPONSE_S = 0.1
"""Ratio of damping to stiffness of an actuator, in which an error falls to 37 %: that of the
source.
"""


def max_torque(joint: str, mass_kg: float) -> float:
    """Return the largest torque, Nm, of a joint such as "left_elbow" of a person of a mass."""
    return STRENGTH_NM_PER_KG[joint.rpartition("_")[2]] * mass_kg


# Degrees (CFR), a third for each of three joints.
_BACK = (("x", -10.0, 30.0), ("z", -10.0, 10.0), ("y", -10.0, 10.0))
# Degrees (CFR), half for each of two joints.
_NECK = (("x", -22.5, 22.5), ("z", -22.5, 22.5), ("y", -40.0, 40.0))

LIMITS: dict[str, tuple[tuple[str, float, float], ...]] = {
    "hip": (("x", -125, 15), ("z", -30, 45), ("y", -45, 45)),  # Merck; Castori
    "knee": (("x", 0, 155),),
    # Merck; about y, which no source has, a small play
    "ankle": (("x", -20, 50), ("z", -35, 25), ("y", -20, 20)),
    "foot": (("x", -80, 30),),  # Merck
    "spine1": _BACK,
    "spine2": _BACK,
    "spine3": _BACK,
    "neck": _NECK,
    "head": _NECK,
    "collar": (("z", -5, 45), ("y", -15, 15), ("x", -45, 0)),  # Dutton
    "shoulder": (("z", -90, 90), ("y", -135, 45), ("x", -90, 70)),  # AAOS; y Dutton
    "elbow": (("y", -155, 0), ("x", -80, 80)),  # x AAOS
    "wrist": (("z", -80, 70), ("y", -20, 30)),  # AAOS
}
"""Hinges of each joint of the left side, in their order, with limits in degrees, 0 in the T-pose (x
left, y up, z forward); those of the right side are mirrored. A pose beyond a limit widens it.

Sources, of adults without disease:

- AAOS: American Academy of Orthopaedic Surgeons, Joint Motion (1965), as quoted in table A.1 of C.
  C. Norkin and D. J. White, Measurement of Joint Motion: shoulder 180 of abduction, 70 and 90 of
  rotation; forearm 80 and 80; wrist 80 of flexion, 70 of extension, 20 and 30 sideways.
- Merck: Merck Manual, Normal Values for Range of Motion of Joints: hip 125 of flexion, 15 of
  extension, 45 of abduction, 45 and 45 of rotation; ankle 20 of dorsiflexion, 50 of plantar
  flexion; foot 35 of inversion, 25 of eversion; toes 30 of flexion, 80 of extension.
- Castori: M. Castori, ISRN Dermatology 2012, 751768, table 8: hip 30 of adduction.
- CFR: 38 CFR 4.71a, note 2 of the rating formula of the spine: neck 45 of flexion, extension and to
  each side, 80 of rotation; back 90 of flexion, 30 of extension, to each side, and of rotation.
- Dutton: AccessPhysiotherapy, Range of Motion for Diarthrodial Joints: clavicle 45 up, 5 down, 15
  to the front and back, 45 of rotation; shoulder 135 and 45 in the horizontal plane.

Knees and elbows bend up to the bound of the reconstruction, 155 degrees; passive bends of deep
squats are beyond the 135 of AAOS and the 130 of Merck.
"""


DENSITY_KG_M3 = 1010.0
"""Density of a human body, whose volume has the lungs half filled."""

NUM_BODIES = 22
"""Pelvis and the 21 joints of the body; fingers belong to the wrist, jaw and eyes to the head."""

FLAT_M = 0.02
"""Height over the lowest point up to which skin flattens on the floor, which is the distance of
contact of the reconstruction.
"""

SOLE_REACH_M = 0.1
"""Height over the ground up to which a foot that touches it has its sole there: one foot of people
who stand is often some centimetres higher than the other, which is an error of the pose.
"""

SOLE_RADIUS_M = 0.005
"""Radius of the spheres at the outline of what is flat."""

_SOLE_POINTS = 8  # the spheres of each outline

_FOOT = {"ankle": "foot", "foot": "ankle"}

_CHILD_OF_LIMB = {"shoulder": "elbow", "elbow": "wrist"}
"""Segments that collide as capsules, and the joint at their other end.

A thigh tapers: its capsule would be up to 5 cm off its skin, and people sit on thighs.
"""


@dataclass(frozen=True)
class Hinge:
    """One axis of a joint.

    Attributes:
        axis: "x", "y" or "z" of the T-pose.
        angle: in the pose of the photo, radians.
        low: limit, radians, at most ``angle``.
        high: limit, radians, at least ``angle``.
        axis_in_pose: (3,) axis in the frame of the segment, in the pose.
        axis_at_rest: (3,) axis in the frame of the segment, where this hinge and those after it are
            0.
    """

    axis: str
    angle: float
    low: float
    high: float
    axis_in_pose: Float64Array
    axis_at_rest: Float64Array


@dataclass(frozen=True)
class Capsule:
    """Collision shape of a limb, in the frame of its segment.

    Attributes:
        ends: (2, 3) centres of the half spheres, metres.
        radius: metres.
    """

    ends: Float64Array
    radius: float


@dataclass(frozen=True)
class Segment:
    """One rigid part of a person. Its frame is that of its joint in the pose.

    Attributes:
        name: of its joint, such as "left_knee"; "pelvis" for the root.
        parent: index of the segment that it hangs on; -1 for the pelvis.
        pose: (4, 4) in the frame of its parent in the pose of the photo, or in that of the file for
            the pelvis.
        zero_pose: (4, 4) the same with all hinges at 0.
        hinges: from the parent to the segment; none for the pelvis.
        mass: kg.
        skin: vertices (V, 3) and faces of its skin.
        hull: the convex hull of its skin, which collides where there is no capsule.
        capsule: collision shape of arms.
        soles: (n, 3) centres of the spheres at the outline of its lowest skin, for feet and what is
            at the floor.
    """

    name: str
    parent: int
    pose: Float64Array
    zero_pose: Float64Array
    hinges: tuple[Hinge, ...]
    mass: float
    skin: Mesh
    hull: Mesh
    capsule: Capsule | None
    soles: Float64Array


def inertia_of(mesh: Mesh, mass: float) -> tuple[Float64Array, Float64Array]:
    """Return the centre of mass (3,), and the moments of inertia (3, 3) about it, kg m2, of a
    closed mesh with uniform density.
    """
    shape = trimesh.Trimesh(*mesh, process=False)
    shape.density = mass / shape.volume
    return np.asarray(shape.center_mass), np.asarray(shape.moment_inertia)


def vertex_segments(weights: Float64Array) -> Int64Array:
    """Return the segment (V,) in 0-21 that each vertex moves with, of skinning weights (V, 55)."""
    merged = np.zeros((len(weights), NUM_BODIES))
    for joint in range(weights.shape[1]):
        above = joint
        while above >= NUM_BODIES:
            above = PARENTS[above]
        merged[:, above] += weights[:, joint]
    body: Int64Array = merged.argmax(1)
    return body


def body_segments(rig: Rig, vertices: Float64Array, ground: Mapping[str, float]) -> list[Segment]:
    """Return the 22 segments of a person in the order of JOINT_NAMES.

    Args:
        rig: in the frame of the file.
        vertices: (V, 3) posed, in that frame, with the floor at z = 0.
        ground: height of the ground under each foot that stands, by side.
    """
    poses = rig.joint_poses()
    part = vertex_segments(rig.weights)
    hulls = [convex_hull(vertices[part == joint]) for joint in range(NUM_BODIES)]
    volumes = np.array([_volume(*hull) for hull in hulls])
    masses = DENSITY_KG_M3 * _volume(vertices, rig.faces) * volumes / volumes.sum()
    lowest = [float(vertices[part == joint, 2].min()) for joint in range(NUM_BODIES)]
    owner = _part_of_faces(part[rig.faces])
    segments = []
    for joint, name in enumerate(JOINT_NAMES[:NUM_BODIES]):
        pose, zero, hinges = _joint_frame(rig, poses, joint)
        position = poses[joint][:3, 3]
        turn = poses[joint][:3, :3]
        local = (vertices - position) @ turn
        used, faces = np.unique(rig.faces[owner == joint], return_inverse=True)
        soles = np.zeros((0, 3))
        if name.endswith(("ankle", "foot")) or lowest[joint] < FLAT_M:
            level = _sole_level(name, lowest, ground)
            soles = _sole_points(local[part == joint], poses[joint][2, :3], lowest[joint] - level)
        hull = (hulls[joint][0] - position) @ turn, hulls[joint][1]
        capsule = _fit_capsule(name, local[part == joint], poses, joint)
        skin = local[used], faces.reshape(-1, 3)
        segments.append(
            Segment(
                name,
                PARENTS[joint],
                pose,
                zero,
                hinges,
                float(masses[joint]),
                skin,
                hull,
                capsule,
                soles,
            )
        )
    return segments


def convex_hull(points: Float64Array) -> Mesh:
    """Return vertices and faces of the convex hull of points (n, 3)."""
    import trimesh

    hull = trimesh.convex.convex_hull(points)
    return np.asarray(hull.vertices), np.asarray(hull.faces)


def _joint_hinges(name: str, rotation: Float64Array) -> tuple[tuple[Hinge, ...], Float64Array]:
    """Return the hinges of a joint whose rotation (3, 3) against the T-pose is that of the pose.

    Also returns the rest of the rotation (3, 3), about axes that the joint does not have.
    """
    side, _, plain = name.rpartition("_")
    limits = LIMITS[plain]
    order = "".join(axis for axis, _, _ in limits)
    order += "".join(axis for axis in "zyx" if axis not in order)
    angles = rotmat_to_euler(order.upper(), rotation)

    def turn(first: int) -> Float64Array:
        """Return the product (3, 3) of the rotations from one on."""
        if first == len(order):
            return np.eye(3)
        turned: Float64Array = Rotation.from_euler(
            order[first:].upper(), angles[first:]
        ).as_matrix()
        return turned.reshape(3, 3)

    rest = turn(len(limits))
    hinges = []
    for axis_number, (axis, low, high) in enumerate(limits):
        direction = np.eye(3)["xyz".index(axis)]
        angle = float(angles[axis_number])
        bounds = np.deg2rad([low, high])
        if side == "right" and axis != "x":
            bounds = -bounds[::-1]
        low = min(bounds[0], angle) - 1e-6
        high = max(bounds[1], angle) + 1e-6
        hinges.append(
            Hinge(axis, angle, low, high, turn(axis_number + 1).T @ direction, rest.T @ direction)
        )
    return tuple(hinges), rest


def _fit_capsule(
    name: str, points: Float64Array, poses: Float64Array, joint: int
) -> Capsule | None:
    """Return the capsule of an arm's points in its frame; None for other parts of the body."""
    side, _, plain = name.rpartition("_")
    if plain not in _CHILD_OF_LIMB:
        return None
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
    return Capsule(center + ends[:, None] * axis, radius)


def _part_of_faces(parts: Int64Array) -> Int64Array:
    """Return the part (F,) of most of the corners (F, 3) of each face; of three, the first."""
    return np.where(parts[:, 1] == parts[:, 2], parts[:, 1], parts[:, 0])


def _joint_frame(
    rig: Rig, poses: Float64Array, joint: int
) -> tuple[Float64Array, Float64Array, tuple[Hinge, ...]]:
    """Return the pose (4, 4) of a joint in the frame of its parent, the same with all hinges at 0,
    and its hinges.
    """
    parent = PARENTS[joint]
    if parent < 0:
        return poses[joint], poses[joint].copy(), ()
    pose = np.linalg.inv(poses[parent]) @ poses[joint]
    zero = pose.copy()
    hinges, zero[:3, :3] = _joint_hinges(JOINT_NAMES[joint], rig.rotations[joint])
    return pose, zero, hinges


def _sole_level(name: str, lowest: Sequence[float], ground: Mapping[str, float]) -> float:
    """Return the height of the sole of a part: heel and ball of a foot have one, on the ground if
    the foot stands.

    Args:
        name: of the joint.
        lowest: height of the lowest skin of each part.
        ground: of :func:`body_segments`.
    """
    level = lowest[JOINT_INDEX[name]]
    side, _, plain = name.rpartition("_")
    if plain not in _FOOT:
        return level
    if side in ground and 0 < level - ground[side] < SOLE_REACH_M:
        return ground[side]
    other = lowest[JOINT_INDEX[f"{side}_{_FOOT[plain]}"]]
    return other if 0 < level - other < FLAT_M else level


def _sole_points(points: Float64Array, up: Float64Array, drop: float) -> Float64Array:
    """Return the centres (n, 3) of spheres at the outline of the lowest skin, on one level, as
    under a shoe.

    MuJoCo finds three neighbouring points of a mesh on a plane, too few to stand on; and a bare
    sole, which is round, flattens under the body's weight. The level is that of the pose, not of
    the joint: a heel that is 1 cm over the floor would otherwise let a balanced body rock by 8
    degrees, and fall.

    Args:
        points: (V, 3) in the frame of the part.
        up: (3,) the vertical in that frame, in the pose of the file.
        drop: depth of the level under the lowest point.
    """
    from scipy.spatial import ConvexHull

    height = points @ up
    sole = height < height.min() + FLAT_M
    if sole.sum() < 8:
        sole = np.argsort(height)[:8]
    level = points[sole] - (height[sole] - height.min() + drop - SOLE_RADIUS_M)[:, None] * up
    flat = level @ np.linalg.svd(up[None])[2][1:].T
    outline: Float64Array = level[ConvexHull(flat).vertices]
    kept_rows = [0]
    while len(kept_rows) < min(_SOLE_POINTS, len(outline)):
        apart = np.linalg.norm(outline[:, None] - outline[kept_rows], axis=2).min(1)
        kept_rows.append(int(apart.argmax()))
    return outline[kept_rows]


def _volume(vertices: Float64Array, faces: Int64Array) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.abs((a * np.cross(b, c)).sum() / 6))
