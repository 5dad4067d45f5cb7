"""People of an export in their pose, and the option that turns them until their mass is over their soles."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from scipy.optimize import linprog, minimize
from scipy.spatial import ConvexHull

from physic_core.body.joints import JOINT_INDEX
from physic_core.geometry.rotations import rotmat_to_rotvec, rotvec_to_rotmat_numpy
from physic_core.geometry.upright import transform_points
from physic_core.types.skeletons import SIDES
from physic_core.visual.rig import rigs
from physic_export.humanoid import FLAT_M, body_segments
from physic_export.skeleton import skinned

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core import ExportRequest
    from physic_core.types import Person
    from physic_core.visual.rig import Rig

    Array = NDArray[np.float64]

INSIDE_M = 0.04
"""Distance of the centre of mass from the edge of the soles after the turn, metres. Where the soles are too narrow, as
on one foot, it goes as far inside as they allow."""

_STEPS = 20  # each turn moves the mass nearly to its aim: the feet, which stay, are 3 % of it
_NEAR_M = 1e-4


@dataclass(frozen=True)
class ExportedPerson:
    """A person of an export.

    Attributes:
        index: of the person in the result.
        rig: in the frame of the file, z up and the floor at z = 0.
        vertices: (V, 3) of the pose.
        turned_deg: angle about the ankles; None if the person was not to be turned.
        inside_m: distance of the centre of mass from the edge of the soles, negative outside; None like the angle.
    """

    index: int
    rig: Rig
    vertices: Array
    turned_deg: float | None = None
    inside_m: float | None = None

    @property
    def note(self) -> str:
        """Return what the turn did; "" without one."""
        if self.turned_deg is None or self.inside_m is None:
            return ""
        place = f"the mass is {100 * self.inside_m:.1f} cm inside the edge of the soles"
        if self.turned_deg == 0:
            return f"person {self.index} is not turned: {place}"
        return f"person {self.index} is turned by {self.turned_deg:.1f} degrees about the ankles: {place}"


def people_of(request: ExportRequest, indices: Sequence[int], *, balance: bool) -> list[ExportedPerson]:
    """Return people of a request in its frame.

    Args:
        request: with z up.
        indices: of the people.
        balance: whether to turn people whom their feet alone carry.
    """
    made = []
    for index, rig in rigs(replace(request, people=tuple(indices))):
        person = request.result.people[index]
        vertices = transform_points(request.frame.from_camera, person.vertices)
        feet = feet_that_carry(person) if balance else ()
        made.append(balanced(index, rig, vertices, feet) if feet else ExportedPerson(index, rig, vertices))
    return made


def feet_that_carry(person: Person) -> tuple[str, ...]:
    """Return the sides of the feet that carry a person alone; none if a seat, a hand or another part carries, too.

    Contact with other people does not count: they may move away.
    """
    contacts = () if person.support is None else person.support.contacts
    carrying = [one for one in contacts if one.partner.kind in ("floor", "scene", "hidden")]
    if any(not one.part.endswith("_foot") or one.partner.kind == "hidden" for one in carrying):
        return ()
    return tuple(side for side in SIDES if any(one.part == f"{side}_foot" for one in carrying))


def balanced(index: int, rig: Rig, vertices: Array, feet: Sequence[str]) -> ExportedPerson:
    """Return a person turned about the ankles until the centre of mass is INSIDE_M inside the soles.

    Masses and soles are those of :func:`physic_export.humanoid.body_segments`. The body above the ankles turns as a
    whole, by the smallest angle; feet that carry keep their direction. The turn is about the middle of the ankles, so
    feet move by millimetres. Then the lowest skin is set on the floor, if it is within FLAT_M of it, since a simulator
    pushes a body out that starts below; else the body is set back to its height.

    Args:
        index: of the person.
        rig: with z up.
        vertices: (V, 3) of its pose.
        feet: the sides of the feet that carry.
    """
    lowest = float(vertices[:, 2].min())
    height = 0.0 if abs(lowest) < FLAT_M else lowest
    turned, posed = _set_down(rig, vertices, height)
    edges, centre = _sole_edges(turned, posed, feet)
    inside = _inside(edges, centre)
    if inside >= INSIDE_M:
        return ExportedPerson(index, turned, posed, 0.0, inside)
    for _ in range(_STEPS):
        aim = _aim(edges, centre)
        if np.linalg.norm(centre[:2] - aim) < _NEAR_M:
            break
        turned = _turned(turned, centre, aim, feet)
        turned, posed = _set_down(turned, skinned(turned), height)
        edges, centre = _sole_edges(turned, posed, feet)
    change = rotmat_to_rotvec(turned.rotations[0] @ rig.rotations[0].T)
    angle = float(np.rad2deg(np.linalg.norm(change)))
    return ExportedPerson(index, turned, posed, angle, _inside(edges, centre))


def _turned(rig: Rig, centre: Array, aim: Array, feet: Sequence[str]) -> Rig:
    """Return a rig whose centre of mass (3,) is turned about the ankles towards the vertical over a point (2,)."""
    world = rig.world()
    ankles = [JOINT_INDEX[f"{side}_ankle"] for side in feet]
    pivot = world[ankles, :3, 3].mean(0)
    arm, to = centre - pivot, np.append(aim - pivot[:2], 0.0)
    to[2] = np.sqrt(max(float(arm @ arm - to @ to), 1e-6))
    axis = np.cross(arm, to)
    angle = np.arctan2(np.linalg.norm(axis), arm @ to)
    axis *= angle / max(float(np.linalg.norm(axis)), 1e-12)
    turn = rotvec_to_rotmat_numpy(axis)
    rotations, offsets = rig.rotations.copy(), rig.offsets.copy()
    rotations[0] = turn @ rotations[0]
    offsets[0] = pivot + turn @ (offsets[0] - pivot)
    for ankle in ankles:
        above = world[rig.parents[ankle], :3, :3]
        rotations[ankle] = (turn @ above).T @ above @ rotations[ankle]
    return replace(rig, rotations=rotations, offsets=offsets)


def _set_down(rig: Rig, vertices: Array, height: float) -> tuple[Rig, Array]:
    """Return rig and vertices moved along z, with the lowest vertex at a height."""
    move = np.array([0.0, 0.0, height - vertices[:, 2].min()])
    offsets = rig.offsets.copy()
    offsets[0] += move
    return replace(rig, offsets=offsets), vertices + move


def _sole_edges(rig: Rig, vertices: Array, feet: Sequence[str]) -> tuple[Array, Array]:
    """Return the edges (n, 3) of the hull of the soles from above, and the centre of mass (3,).

    An edge is its unit normal outwards and its offset.
    """
    segments, world = body_segments(rig, vertices), rig.world()
    masses = np.array([one.mass for one in segments])
    centres = [
        pose[:3, :3] @ trimesh.Trimesh(*one.hull, process=False).center_mass + pose[:3, 3]
        for one, pose in zip(segments, world, strict=False)
    ]
    joints = [JOINT_INDEX[f"{side}_{name}"] for side in feet for name in ("ankle", "foot")]
    soles = [segments[joint].soles @ world[joint, :3, :3].T + world[joint, :3, 3] for joint in joints]
    edges: Array = ConvexHull(np.concatenate(soles)[:, :2]).equations
    return edges, masses @ np.stack(centres) / masses.sum()


def _inside(edges: Array, centre: Array) -> float:
    return float(-(edges[:, :2] @ centre[:2] + edges[:, 2]).max())


def _aim(edges: Array, centre: Array) -> Array:
    """Return the point (2,) nearest to a centre (3,) that is INSIDE_M inside the edges, or as far as they allow."""
    widest = linprog(
        [0, 0, -1], np.pad(edges[:, :2], ((0, 0), (0, 1)), constant_values=1.0), -edges[:, 2], bounds=(None, None)
    )
    room = min(INSIDE_M, float(widest.x[2]))
    limits = {"type": "ineq", "fun": lambda point: -(edges[:, :2] @ point + edges[:, 2]) - room}
    nearest = minimize(
        lambda point: ((point - centre[:2]) ** 2).sum(), widest.x[:2], method="SLSQP", constraints=limits
    )
    aim: Array = nearest.x
    return aim
