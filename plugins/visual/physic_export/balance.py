"""People of a simulation: in their pose, those on their feet turned until their mass is over the
soles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from scipy.optimize import linprog, minimize
from scipy.spatial import ConvexHull

from physic_core.body import JOINT_INDEX
from physic_core.geometry import rotation_between, rotmat_to_rotvec, transform_points
from physic_core.types import SIDES, SupportState
from physic_export.humanoid import (
    FLAT_M,
    NUM_BODIES,
    SOLE_REACH_M,
    body_segments,
    vertex_segments,
)
from physic_export.tiles import FLOOR_M, Tile, convex_tiles, step_under, tiles_without
from physic_visual.rig import rigs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core import ExportRequest
    from physic_core.types import Float64Array, Int64Array, Person
    from physic_visual.rig import Rig


INSIDE_M = 0.04
"""Distance of the centre of mass from the edge of the soles after the turn, metres.

Where the soles are too narrow, as on one foot, it goes as far inside as they allow.
"""

MAX_TURN_DEG = 15.0
"""Largest turn: the lean of a photo is off by less."""

_STEPS = 20  # each turn moves the mass nearly to its aim: the feet, which stay, are 3 % of it
_NEAR_M = 1e-4


@dataclass(frozen=True)
class ExportedPerson:
    """A person of an export.

    Attributes:
        index: of the person in the result.
        rig: in the frame of the file, z up and the floor at z = 0.
        vertices: (V, 3) of the pose.
        carrying_feet: sides of the feet that carry the person alone; none if another part carries,
            too.
        feet_on_floor: sides of the feet that touch the floor, with the heel less than SOLE_REACH_M
            over it.
        is_unsteady: whether the result says that the feet carry the person on too little ground.
        why_falling: why a simulation does not keep the person up; "" if it does, or if that is not
            known.
        turned_deg: angle about the ankles; None if the person was not to be turned.
        inside_m: distance of the centre of mass from the edge of the soles, negative outside; None
            like the angle.
    """

    index: int
    rig: Rig
    vertices: Float64Array
    carrying_feet: tuple[str, ...] = ()
    feet_on_floor: tuple[str, ...] = ()
    is_unsteady: bool = False
    why_falling: str = ""
    turned_deg: float | None = None
    inside_m: float | None = None

    @property
    def ground_heights(self) -> dict[str, float]:
        """Height of the ground under each foot that stands: the floor, or a step of the scene."""
        part = vertex_segments(self.rig.weights)
        steps = {side: float(self.foot(side, part)[:, 2].min()) for side in self.carrying_feet}
        return steps | dict.fromkeys(self.feet_on_floor, 0.0)

    def foot(self, side: str, part: Int64Array) -> Float64Array:
        """Return the vertices (n, 3) of a foot; ``part`` (V,) are the segments of the vertices."""
        joints = [JOINT_INDEX[f"{side}_{name}"] for name in ("ankle", "foot")]
        return self.vertices[np.isin(part, joints)]

    @property
    def note(self) -> str:
        """Return what the turn did, or why the person falls; "" if neither is known."""
        if self.why_falling:
            return f"person {self.index} falls in a simulation: {self.why_falling}"
        if self.turned_deg is None or self.inside_m is None:
            return ""
        place = f"the mass is {100 * self.inside_m:.1f} cm inside the edge of the soles"
        if self.is_unsteady:
            place += ", and it stands on too little ground: it may fall"
        if self.turned_deg == 0:
            return f"person {self.index} is not turned: {place}"
        return (
            f"person {self.index} is turned by {self.turned_deg:.1f} degrees about the ankles: "
            f"{place}"
        )


def tiles_beside(
    request: ExportRequest, people: Sequence[ExportedPerson]
) -> tuple[list[Tile], tuple[str, ...]]:
    """Return convex tiles of the scene, and notes on tiles that are left out.

    A tile is left out if it reaches into a person carried by feet alone: it would push the person
    over. Feet on the scene get flat steps, which are tiles too: the surface of a photo reaches
    centimetres into such feet, or ends below them.
    """
    tiles = convex_tiles(request.result)
    to_camera: Float64Array = np.linalg.inv(request.frame.from_camera).astype(np.float64)
    bodies = []
    steps = []
    for person in people:
        if not person.carrying_feet:
            continue
        part = vertex_segments(person.rig.weights)
        vertices = transform_points(to_camera, person.vertices)
        bodies += [vertices[part == joint] for joint in range(NUM_BODIES)]
        steps += [
            step_under(person.foot(side, part), to_camera)
            for side in person.carrying_feet
            if side not in person.feet_on_floor
        ]
    free_tiles = tiles_without(tiles, bodies)
    left_out = len(tiles) - len(free_tiles)
    return free_tiles + steps, (
        f"{left_out} convex tiles of the scene reach into people and are left out",
    ) if left_out else ()


def people_of(request: ExportRequest) -> list[ExportedPerson]:
    """Return the people of a request in its frame, which has z up.

    People whom their feet alone balance within the error of the pose are turned over their soles,
    unless the option ``keep_lean`` is given.
    """
    people = []
    for index, rig in rigs(request):
        person = request.result.people[index]
        vertices = transform_points(request.frame.from_camera, person.vertices)
        part = vertex_segments(rig.weights)
        heels = {
            side: float(vertices[part == JOINT_INDEX[f"{side}_ankle"], 2].min()) for side in SIDES
        }
        touching = _feet_on_floor(person, heels)
        on_floor = tuple(side for side in touching if heels[side] < SOLE_REACH_M)
        carrying = feet_that_carry(person)
        falls = "" if carrying else _why_falling(person)
        # a surface may have no collision shape
        feet = tuple(side for side in carrying if side in on_floor)
        if not feet:
            feet = tuple(side for side in carrying if side not in touching)
        if carrying and not feet:
            over = min(heels[side] for side in carrying)
            falls = f"its soles are {100 * over:.0f} cm over the floor"
        elif feet and not on_floor and not request.scene:
            falls = "it stands on the scene, which is left out"
        unsteady = person.support is not None and person.support.state is SupportState.UNSTEADY
        plain = ExportedPerson(index, rig, vertices, feet, on_floor, unsteady, falls)
        if feet:
            lowest = float(vertices[:, 2].min())
            plain = _moved_to_height(plain, 0.0 if abs(lowest) < FLAT_M else lowest)
        people.append(balance_person(plain) if feet and not request.options["keep_lean"] else plain)
    return people


def feet_that_carry(person: Person) -> tuple[str, ...]:
    """Return the sides of the feet that balance a person alone; none if a seat, a hand or another
    part carries, too.

    Contact with other people does not count: they may move away.
    """
    if person.support is None or person.support.state not in (
        SupportState.BALANCED,
        SupportState.UNSTEADY,
        SupportState.ASSUMED,
    ):
        return ()
    carrying = [
        one for one in person.support.contacts if one.partner.kind in ("floor", "scene", "hidden")
    ]
    if any(not one.part.endswith("_foot") or not one.partner.in_scene for one in carrying):
        return ()
    return tuple(side for side in SIDES if any(one.part == f"{side}_foot" for one in carrying))


def _why_falling(person: Person) -> str:
    if person.support is None:
        return "nothing is known to carry it"
    return "" if person.support.state is SupportState.BALANCED else str(person.support)


def _feet_on_floor(person: Person, heels: dict[str, float]) -> tuple[str, ...]:
    """Return the sides of the feet that touch the floor, or the scene where it counts as the floor
    (FLOOR_M), by the height of the lowest skin of heel and instep, metres.
    """
    likely = [one for one in person.contacts if one.likely]
    sides = []
    for side in SIDES:
        kinds = {one.partner.kind for one in likely if one.part == f"{side}_foot"}
        if "floor" in kinds or ("scene" in kinds and heels[side] < FLOOR_M):
            sides.append(side)
    return tuple(sides)


def balance_person(person: ExportedPerson) -> ExportedPerson:
    """Return a person turned about the ankles until the centre of mass is INSIDE_M inside the
    soles.

    Masses and soles are those of :func:`physic_export.humanoid.body_segments`. The body above the
    ankles turns as a whole, by the smallest angle; feet that carry keep their direction. The turn
    is about the middle of the ankles, so feet move by millimetres. Then the lowest skin is set on
    the floor, if it is within FLAT_M of it, since a simulator pushes a body out that starts below;
    else the body is set back to its height.

    Args:
        person: with z up, whom their feet alone carry.
    """
    height = float(person.vertices[:, 2].min())
    turned = person
    edges, centre = _sole_edges(turned)
    inside = _distance_inside(edges, centre)
    if inside >= INSIDE_M:
        return replace(person, turned_deg=0.0, inside_m=inside)
    for _ in range(_STEPS):
        aim = _balance_point(edges, centre)
        if np.linalg.norm(centre[:2] - aim) < _NEAR_M:
            break
        rig = _turned_about_ankles(turned.rig, centre, aim, person.carrying_feet)
        turned = _moved_to_height(replace(turned, rig=rig, vertices=rig.posed_vertices()), height)
        edges, centre = _sole_edges(turned)
    change = rotmat_to_rotvec(turned.rig.rotations[0] @ person.rig.rotations[0].T)
    angle = float(np.rad2deg(np.linalg.norm(change)))
    if angle > MAX_TURN_DEG:
        return replace(person, why_falling=f"its mass is {-100 * inside:.0f} cm outside its soles")
    return replace(turned, turned_deg=angle, inside_m=_distance_inside(edges, centre))


def _turned_about_ankles(
    rig: Rig, centre: Float64Array, aim: Float64Array, feet: Sequence[str]
) -> Rig:
    """Return a rig whose centre of mass (3,) is turned about the ankles towards the vertical over a
    point (2,).
    """
    world = rig.joint_poses()
    ankles = [JOINT_INDEX[f"{side}_ankle"] for side in feet]
    pivot = world[ankles, :3, 3].mean(0)
    arm = centre - pivot
    to = np.append(aim - pivot[:2], 0.0)
    to[2] = np.sqrt(max(float(arm @ arm - to @ to), 1e-6))
    turn = rotation_between(arm, to)
    rotations = rig.rotations.copy()
    offsets = rig.offsets.copy()
    rotations[0] = turn @ rotations[0]
    offsets[0] = pivot + turn @ (offsets[0] - pivot)
    for ankle in ankles:
        parent_rotation = world[rig.parents[ankle], :3, :3]
        rotations[ankle] = (turn @ parent_rotation).T @ parent_rotation @ rotations[ankle]
    return replace(rig, rotations=rotations, offsets=offsets)


def _moved_to_height(person: ExportedPerson, height: float) -> ExportedPerson:
    """Return a person moved along z, with the lowest vertex at a height."""
    move = np.array([0.0, 0.0, height - person.vertices[:, 2].min()])
    offsets = person.rig.offsets.copy()
    offsets[0] += move
    return replace(
        person, rig=replace(person.rig, offsets=offsets), vertices=person.vertices + move
    )


def _sole_edges(person: ExportedPerson) -> tuple[Float64Array, Float64Array]:
    """Return the edges (n, 3) of the hull of the soles from above, and the centre of mass (3,).

    An edge is its unit normal outwards and its offset. Toes do not count: they are too weak to
    balance a body.
    """
    segments = body_segments(person.rig, person.vertices, person.ground_heights)
    world = person.rig.joint_poses()
    masses = np.array([one.mass for one in segments])
    centres = [
        pose[:3, :3] @ trimesh.Trimesh(*one.hull, process=False).center_mass + pose[:3, 3]
        for one, pose in zip(segments, world, strict=False)
    ]
    joints = [JOINT_INDEX[f"{side}_ankle"] for side in person.carrying_feet]
    soles = [
        segments[joint].soles @ world[joint, :3, :3].T + world[joint, :3, 3] for joint in joints
    ]
    edges: Float64Array = ConvexHull(np.concatenate(soles)[:, :2]).equations
    return edges, masses @ np.stack(centres) / masses.sum()


def _distance_inside(edges: Float64Array, centre: Float64Array) -> float:
    return float(-(edges[:, :2] @ centre[:2] + edges[:, 2]).max())


def _balance_point(edges: Float64Array, centre: Float64Array) -> Float64Array:
    """Return the point (2,) nearest to a centre (3,) that is INSIDE_M inside the edges, or as far
    as they allow.
    """
    widest = linprog(
        [0, 0, -1],
        np.pad(edges[:, :2], ((0, 0), (0, 1)), constant_values=1.0),
        -edges[:, 2],
        bounds=(None, None),
    )
    room = min(INSIDE_M, float(widest.x[2]))
    limits = {"type": "ineq", "fun": lambda point: -(edges[:, :2] @ point + edges[:, 2]) - room}
    nearest = minimize(
        lambda point: ((point - centre[:2]) ** 2).sum(),
        widest.x[:2],
        method="SLSQP",
        constraints=limits,
    )
    aim: Float64Array = nearest.x
    return aim
