"""Whether people stay where they are when gravity acts: two seconds in MuJoCo with passive joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core import ExportRequest
from physic_core.body.joints import JOINT_NAMES
from physic_core.body.posture import lean_deg
from physic_core.types.support import SupportState
from physic_core.visual.export.request import export_frame
from physic_core.visual.rig import body_of_result
from physic_export.balance import people_of
from physic_export.humanoid import NUM_BODIES, vertex_segments
from physic_export.mjcf import mjcf_text, mjcf_tree
from physic_export.tiles import convex_tiles

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from physic_core.types import Person, Plane, Reconstruction
    from physic_export.balance import ExportedPerson
    from physic_export.tiles import Tile

    Array = NDArray[np.float64]

STAY_M = 0.05
"""Distance up to which a person stays, metres: of the pelvis, and of the parts that carry, over the whole time."""

FALL_M = 0.2
"""Drop of the highest point from which on a person who does not stay falls, metres: more than a soft seat gives way."""

LYING_DEG = 45.0
"""Angle of the trunk from the vertical from which on a person whose trunk or seat is carried lies: nearer to level."""

CONTROLS = ("raised", "tilted", "no contact")
"""Changes after which no person should stay: the body 0.25 m higher, the floor tilted by 10 degrees backward under the
person, and floor and scene without collisions."""

_RAISED_M, _TILT = 0.25, np.deg2rad(10.0)
_MIN_VERTICES = 10  # of a body part in contact, so that it counts as carrying


@dataclass(frozen=True)
class Motion:
    """What a person did.

    Attributes:
        person: index.
        posture: see :func:`posture`.
        control: one of CONTROLS, or "" for the result as it is.
        moved_m: greatest distance of the pelvis from its start.
        slip_m: greatest horizontal distance of a carrying part from its start; None if nothing carries.
        sinking_m: greatest drop of the pelvis.
        unseen: names of supports in the result that the scene does not have, such as "hidden seat".
        contacts: number of parts that the result has in contact with floor or scene.
        lasting: number of these that touch floor or scene at the end.
        start: (n, 3) vertices of the skin before, m, z up.
        end: (n, 3) the same after.
        faces: (F, 3) of both.
        turn: what the option "balance" did; "" without it.
    """

    person: int
    posture: str
    control: str
    moved_m: float
    slip_m: float | None
    sinking_m: float
    unseen: tuple[str, ...]
    contacts: int
    lasting: int
    start: Array
    end: Array
    faces: NDArray[np.int64]
    turn: str = ""

    @property
    def stays(self) -> bool:
        """Whether pelvis and carrying parts stay within STAY_M, and a contact lasts if there was one."""
        near = self.moved_m <= STAY_M and (self.slip_m or 0.0) <= STAY_M
        return near and (self.lasting > 0 or not self.contacts)

    @property
    def outcome(self) -> str:
        """Return "stays", "falls", "slides" (the carrying parts move), or "moves"."""
        if self.stays:
            return "stays"
        if self.start[:, 2].max() - self.end[:, 2].max() > FALL_M:
            return "falls"
        return "slides" if (self.slip_m or 0.0) > STAY_M else "moves"

    @property
    def explanation(self) -> str:
        """Return why a person who does not stay cannot; "" if nothing in the result explains it."""
        if self.stays or self.control:
            return ""
        if self.unseen:
            lost = ", ".join(f"the {name.removeprefix('hidden ')}" for name in self.unseen)
            return f"the scene does not have {lost} of person {self.person}, who {self.outcome}"
        if self.posture == "in motion":
            return f"person {self.person} {self.outcome}, as people in motion do"
        return ""


def posture(person: Person, floor: Plane) -> str:
    """Return "stands on both feet", "sits", "lies", or "in motion".

    People whose supports list a seat sit or lie, also on a seat that the scene does not have. A person without a seat
    is in motion if they are not balanced over contacts that the photo shows, or stand on one foot.
    """
    support = person.support
    if support is None:
        return "in motion"
    lies = lean_deg(person.joints, floor, "trunk")[0] > LYING_DEG
    if any(one.part == "seat" or one.partner.surface == "seat" for one in support.contacts):
        return "lies" if lies else "sits"
    if support.state != SupportState.BALANCED:
        return "in motion"
    parts = {one.part for one in support.contacts if one.partner.kind in ("floor", "scene")}
    if parts & {"back", "torso", "left_upper_leg", "right_upper_leg"}:
        return "lies" if lies else "sits"
    return "stands on both feet" if {"left_foot", "right_foot"} <= parts else "in motion"


def simulate_people(
    result: Reconstruction,
    people: Sequence[int],
    *,
    seconds: float = 2.0,
    control: str = "",
    balance: bool = False,
    body_file: Path | None = None,
    tiles: Sequence[Tile] | None = None,
) -> list[Motion]:
    """Let each person stand alone, with the others as rigid obstacles.

    No force acts on the root, and starting penetration is not removed.

    Args:
        result: with a floor.
        people: indices of people with a body.
        seconds: simulated time.
        control: one of CONTROLS, or "".
        balance: whether to turn people whom their feet alone carry, see :func:`physic_export.balance.balanced`.
        body_file: SMPL-X file of the user.
        tiles: of the scene; None to make them.

    Raises:
        InputError: there is no floor, or the skeleton is not known.
    """
    posed = tuple(index for index, one in enumerate(result.people) if np.isfinite(one.vertices).all())
    request = ExportRequest(result, posed, export_frame(result.scene.floor, "z"), "a", ".xml", body_file=body_file)
    tiles = convex_tiles(result) if tiles is None else tiles
    part = vertex_segments(body_of_result(result, body_file).skin.weights.T.double().numpy())
    jointed = people_of(request, people, balance=balance)
    return [_simulate(request, one, tiles, part, seconds, control) for one in jointed]


def _simulate(
    request: ExportRequest,
    exported: ExportedPerson,
    tiles: Sequence[Tile],
    part: NDArray[np.int64],
    seconds: float,
    control: str,
) -> Motion:
    import mujoco

    model = mujoco.MjModel.from_xml_string(mjcf_text(mjcf_tree(request, tiles, [exported], springs=True)).decode())
    data = mujoco.MjData(model)
    index = exported.index
    name, person = f"person_{index}", request.result.people[index]
    bodies = [model.body(name if j == 0 else f"{name}_{JOINT_NAMES[j]}").id for j in range(NUM_BODIES)]
    mujoco.mj_forward(model, data)
    _change(model, data, bodies[0], model.joint(f"{name}_root").qposadr[0], control)
    mujoco.mj_forward(model, data)
    carrying = [bodies[j] for j in _carrying(request.result, person, part)]
    ground = {g for g in range(model.ngeom) if model.geom(g).name == "floor" or model.geom(g).name.startswith("scene_")}
    places, start = data.xpos.copy(), _skin(model, data, bodies)
    moved = sinking = slip = 0.0
    while data.time < seconds:
        mujoco.mj_step(model, data)
        away = data.xpos - places
        moved = max(moved, float(np.linalg.norm(away[bodies[0]])))
        sinking = max(sinking, float(-away[bodies[0], 2]))
        slip = max([slip, *(float(np.linalg.norm(away[body, :2])) for body in carrying)])
    touching: set[int] = set()
    for contact in data.contact:
        for one, other in ((contact.geom1, contact.geom2), (contact.geom2, contact.geom1)):
            if one in ground:
                touching.add(int(model.geom_bodyid[other]))
    lasting = sum(body in touching for body in carrying)
    end, faces = _skin(model, data, bodies), _faces(model, bodies)
    floor, support = request.result.scene.floor, person.support
    what = "in motion" if floor is None else posture(person, floor)
    unseen = () if support is None else support.hidden
    carried = slip if carrying else None
    return Motion(
        index, what, control, moved, carried, sinking, unseen, len(carrying), lasting, start, end, faces, exported.note
    )


def _change(model: Any, data: Any, pelvis: int, root: int, control: str) -> None:
    """Apply a control."""
    import mujoco

    if control == "raised":
        data.qpos[root + 2] += _RAISED_M
    elif control == "tilted":
        floor = model.geom("floor").id
        forward = data.xmat[pelvis].reshape(3, 3)[:, 2] * [1, 1, 0]
        forward = forward / max(np.linalg.norm(forward), 1e-9)
        model.geom_sameframe[floor] = 0  # otherwise MuJoCo takes the frame of the world
        model.geom_pos[floor] = data.xpos[pelvis] * [1, 1, 0]
        mujoco.mju_axisAngle2Quat(model.geom_quat[floor], np.cross([0, 0, 1], -forward), _TILT)
    elif control == "no contact":
        for geom in range(model.ngeom):
            if model.geom(geom).name == "floor" or model.geom(geom).name.startswith("scene_"):
                model.geom_contype[geom] = model.geom_conaffinity[geom] = 0


def _carrying(result: Reconstruction, person: Person, part: NDArray[np.int64]) -> list[int]:
    """Return the bodies (0 to 21) that the result has in contact with floor or scene."""
    touches = np.asarray(person.contact, bool)
    if person.contact_partner is not None:
        ground = np.array([one.kind in ("floor", "scene") for one in result.contact_partners] + [False])
        touches = touches & ground[np.asarray(person.contact_partner, np.int64)]
    counts = np.bincount(part[touches], minlength=NUM_BODIES)
    return np.flatnonzero(counts >= _MIN_VERTICES).tolist()


def _meshes(model: Any, bodies: list[int]) -> list[tuple[int, int]]:
    """Return geom and mesh of the skin of each body."""
    return [
        (geom, int(model.geom_dataid[geom]))
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] in bodies and model.geom(geom).name.endswith("_skin")
    ]


def _skin(model: Any, data: Any, bodies: list[int]) -> Array:
    posed = []
    for geom, mesh in _meshes(model, bodies):
        first = model.mesh_vertadr[mesh]
        local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        posed.append(local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(posed)


def _faces(model: Any, bodies: list[int]) -> NDArray[np.int64]:
    faces, start = [], 0
    for _, mesh in _meshes(model, bodies):
        first = model.mesh_faceadr[mesh]
        faces.append(model.mesh_face[first : first + model.mesh_facenum[mesh]].astype(np.int64) + start)
        start += int(model.mesh_vertnum[mesh])
    return np.concatenate(faces)
