"""Start poses of one person's actions, with the furniture of each, varied by seed.

Each action plans one person at the origin who faces +z, on level ground at y = 0; :func:`turned` carries a plan
elsewhere. The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from physic_testing.worlds import furniture
from physic_testing.worlds.contact_fit import ContactTarget, PosePlan, PositionTarget, pose_body
from physic_testing.worlds.pose_builder import PoseBuilder
from physic_testing.worlds.reproducible_math import apply, norm
from physic_testing.worlds.solids import Block, yaw_matrix

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = [
    "SOLO_ACTIONS",
    "MeasuredBody",
    "draw_person",
    "knee_hollow_height",
    "lay_hand_on_thigh",
    "lie_on_back",
    "measure_person",
    "move_plan",
    "seated_legs",
    "sit_on_bench",
    "sit_on_sofa",
    "sit_on_steps",
    "stand",
    "stand_on_steps",
    "steps_outside",
    "walk",
]

_SIDES = ("left", "right")


@dataclass(frozen=True)
class MeasuredBody:
    """Body shape and lengths measured on the body, m.

    Attributes:
        betas: (K,) shape.
        stature: sole to crown.
        thigh: hip to knee joint.
        shank: knee joint to sole.
        leg: pelvis joint to sole, standing.
        seat: approximate height of the pelvis joint above the seat.
        arm: shoulder to wrist.
        shoulder: height of the shoulder joints above the pelvis joint.
        behind: distance from the pelvis joint to the rear of back and buttocks.
    """

    betas: FloatArray
    stature: float
    thigh: float
    shank: float
    leg: float
    seat: float
    arm: float
    shoulder: float
    behind: float


def draw_person(model: BodyModel, rng: np.random.Generator, *, adult: bool = False) -> MeasuredBody:
    """Draw a random body shape: an adult's, or in one of seven draws a child's, unless ``adult`` is set."""
    betas = np.clip(rng.normal(0, 0.6, model.num_betas), -1.3, 1.3)
    betas[0] = np.clip(rng.normal(0.15, 0.5), -0.9, 1.2)
    if not adult and rng.random() < 0.14:
        betas[0] = rng.uniform(-2.6, -1.5)
        betas[1:] *= 0.6
    return measure_person(model, betas)


def measure_person(model: BodyModel, betas: FloatArray) -> MeasuredBody:
    """Measure the body of a shape (K,)."""
    vertices, joints = pose_body(model, np.zeros((55, 3)), betas, np.zeros(3))
    height = vertices[model.outer.numpy(), 1]
    sole = float(height.min())
    stature = float(height.max()) - sole
    torso = vertices[model.contact_sets["gluteus"].numpy()]
    return MeasuredBody(
        betas=betas,
        stature=stature,
        thigh=float(norm(joints[1] - joints[4])),
        shank=float(joints[4, 1]) - sole,
        leg=float(joints[0, 1]) - sole,
        seat=0.075 * stature / 1.7 + 0.02,
        arm=float(norm(joints[16] - joints[18]) + norm(joints[18] - joints[20])),
        shoulder=float(joints[16, 1] - joints[0, 1]),
        behind=float(joints[0, 2] - torso[:, 2].min()),
    )


def move_plan(plan: PosePlan, place: tuple[float, float], yaw: float, lift: float = 0.0) -> PosePlan:
    """Rotate a plan about the vertical by ``yaw`` radians, then move it to (x, z) and up by ``lift``."""
    turn = yaw_matrix(yaw)

    def carried(point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = apply(turn, np.array(point)) + np.array([place[0], lift, place[1]])
        return float(x), float(y), float(z)

    pose = plan.pose.copy()
    pose[0] = (Rotation.from_matrix(turn) * Rotation.from_rotvec(pose[0])).as_rotvec()
    return replace(
        plan,
        pose=pose,
        pelvis=carried(plan.pelvis),
        blocks=furniture.move_blocks(plan.blocks, place, yaw, lift),
        reaches=tuple(replace(reach, point=carried(reach.point)) for reach in plan.reaches),
    )


# ---- arms ----------------------------------------------------------------------------------------------------------


def _hang_arm(posture: PoseBuilder, side: str, rng: np.random.Generator) -> None:
    """Pose a hanging arm, slightly bent."""
    out, forward = rng.uniform(0.16, 0.30), rng.uniform(-0.08, 0.12)
    posture.arm(side, (out, -1, forward), (out - 0.16, -1, forward + rng.uniform(0.15, 0.45)), (-1, 0, -0.2))
    posture.fingers(side, rng.uniform(10, 28), rng)


def _pose_free_arm(posture: PoseBuilder, side: str, rng: np.random.Generator) -> None:
    """Pose an arm without a target: hanging, talking, raised, pointing or bent."""
    kind = rng.choice(["hang", "hang", "hang", "talk", "raise", "point", "bent"])
    if kind == "hang":
        _hang_arm(posture, side, rng)
        return
    if kind == "talk":
        up = rng.uniform(-0.3, 0.5)
        posture.arm(side, (0.35, -1, 0.25), (rng.uniform(-0.1, 0.4), up, 1), (-0.3, 1, 0.2))
    elif kind == "raise":
        posture.arm(side, (1, rng.uniform(-0.1, 0.5), 0.25), (0.15, 1, 0.25), (0, 0.1, 1))
    elif kind == "point":
        up = rng.uniform(-0.3, 0.25)
        posture.arm(side, (0.35, up - 0.25, 1), (0.25, up, 1), (-0.3, -1, 0))
    else:
        posture.arm(side, (0.30, -1, 0.05), (-0.15, rng.uniform(-0.2, 0.25), 1), (-1, -0.2, 0))
    posture.fingers(side, rng.uniform(6, 30), rng)


def _turn_head(posture: PoseBuilder, rng: np.random.Generator, nod: float = 3.0, wide: float = 30.0) -> None:
    """Turn the head at random."""
    posture.head(nod + rng.uniform(-8, 10), rng.uniform(-wide, wide), rng.uniform(-6, 6))


def lay_hand_on_thigh(posture: PoseBuilder, side: str, rng: np.random.Generator) -> tuple[ContactTarget, ...]:
    """Pose an arm with the hand on the thigh of a sitting person."""
    posture.arm(side, (0.22, -1, rng.uniform(0.25, 0.5)), (rng.uniform(-0.12, 0.02), -0.42, 1), (0, -1, 0))
    posture.fingers(side, rng.uniform(8, 20), rng)
    return (ContactTarget(f"{side}_palm", 0.25, on="self", target=f"{side}_lap"),)


# ---- upright -------------------------------------------------------------------------------------------------------


def _soles() -> tuple[ContactTarget, ...]:
    """Return contact targets of both soles."""
    return tuple(ContactTarget(f"{side}_sole", 0.6) for side in _SIDES)


def _upright_legs(posture: PoseBuilder, rng: np.random.Generator) -> None:
    """Pose the legs of a standing person."""
    apart, ahead = rng.uniform(2, 7), rng.uniform(-5, 5)
    relaxed = rng.choice(_SIDES) if rng.random() < 0.5 else ""
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        bend = rng.uniform(8, 22) if side == relaxed else rng.uniform(0, 5)
        posture.leg(side, sign * ahead + bend / 2, bend, apart=apart)
        posture.foot(side, out=rng.uniform(3, 16))


def stand(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person standing on both feet."""
    posture = PoseBuilder((rng.uniform(-1, 3), 0, 0)).trunk(rng.uniform(-2, 5), rng.uniform(-8, 8), rng.uniform(-3, 3))
    _upright_legs(posture, rng)
    _turn_head(posture, rng)
    touches: tuple[ContactTarget, ...] = ()
    if rng.random() < 0.15:  # arms folded low before the belly
        for side, up in zip(_SIDES, (0.12, -0.02), strict=True):
            posture.arm(side, (0.34, -1, 0.22), (-0.75, up, 0.62), (0, -1, 0.2))
            posture.fingers(side, 12, rng)
    elif rng.random() < 0.15:  # hands on the hips
        for side in _SIDES:
            posture.arm(side, (0.75, -0.8, -0.25), (-0.62, -0.62, 0.42), (-0.6, -0.8, 0))
            posture.fingers(side, 14, rng)
    else:
        for side in _SIDES:
            _pose_free_arm(posture, side, rng)
    pelvis = (0.0, person.leg - 0.005, 0.0)
    return PosePlan("stand", posture.pose, person.betas, pelvis, touches=_soles() + touches, balanced=True)


def walk(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person in mid-stride: front sole on the ground, rear heel raised."""
    front = str(rng.choice(_SIDES))
    rear = "right" if front == "left" else "left"
    stride = rng.uniform(15, 24)
    twist = rng.uniform(3, 8) * (1 if front == "right" else -1)
    posture = PoseBuilder((rng.uniform(1, 4), 0, 0)).trunk(rng.uniform(0, 4), twist)
    posture.leg(front, stride, rng.uniform(4, 12), apart=1).foot(front, out=rng.uniform(2, 9))
    raised = rng.uniform(22, 42)
    posture.leg(rear, -stride * 0.8, rng.uniform(14, 30), apart=1).foot(rear, out=rng.uniform(2, 9), raised=raised)
    posture.toes(rear, 0.75 * raised)
    _turn_head(posture, rng, wide=20)
    for side, ahead in ((front, -1), (rear, 1)):
        swing = ahead * rng.uniform(0.25, 0.5)
        posture.arm(side, (0.2, -1, swing), (0.0, -1, swing + rng.uniform(0.25, 0.6)), (-1, 0, 0))
        posture.fingers(side, rng.uniform(12, 30), rng)
    touches = (ContactTarget(f"{front}_sole", 0.6), ContactTarget(f"{rear}_ball", 0.35))
    pelvis = (0.0, person.leg * np.cos(np.radians(stride)) + 0.01, 0.0)
    return PosePlan("walk", posture.pose, person.betas, pelvis, touches=touches, balanced=True)


def squat(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person squatting on both feet."""
    deep = rng.uniform(100, 122)
    thigh = rng.uniform(72, 92)
    heel = max(0.0, rng.uniform(-25, 25))
    posture = PoseBuilder((rng.uniform(28, 40), 0, 0)).trunk(rng.uniform(18, 32), rng.uniform(-5, 5))
    for side in _SIDES:
        posture.leg(side, thigh, deep, spread=rng.uniform(16, 26)).foot(side, out=rng.uniform(10, 20), raised=heel)
        posture.toes(side, 0.8 * heel)
        forward = rng.uniform(0.6, 1.2)
        posture.arm(side, (0.25, -0.75, forward), (-0.2, rng.uniform(-0.3, 0.15), 1), (-0.6, -1, 0))
        posture.fingers(side, rng.uniform(10, 30), rng)
    posture.head(-rng.uniform(15, 40), rng.uniform(-20, 20))
    shin = np.radians(deep - thigh)
    height = person.shank * np.cos(shin) + person.thigh * -np.cos(np.radians(thigh)) * -1
    touches = tuple(ContactTarget(f"{side}_{'ball' if heel > 3 else 'sole'}", 0.6) for side in _SIDES)
    pelvis = (0.0, float(height) + 0.05, 0.0)
    return PosePlan("squat", posture.pose, person.betas, pelvis, touches=touches, balanced=True)


def kneel(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person kneeling: upright on both knees, sitting on the heels, or on one knee."""
    kind = str(rng.choice(["upright", "heels", "one"]))
    lean = rng.uniform(0, 10)
    posture = PoseBuilder((lean if kind != "heels" else rng.uniform(5, 18), 0, 0)).trunk(
        rng.uniform(2, 14), rng.uniform(-6, 6)
    )
    _turn_head(posture, rng)
    down = list(_SIDES)
    touches: list[ContactTarget] = []
    if kind == "one":
        front = str(rng.choice(_SIDES))
        down.remove(front)
        posture.leg(front, rng.uniform(82, 92), rng.uniform(82, 95), spread=8).foot(front, out=8)
        touches.append(ContactTarget(f"{front}_sole", 0.6))
    for side in down:
        if kind == "heels":
            posture.leg(side, rng.uniform(62, 68), 150, spread=rng.uniform(6, 14)).ankle(side, point=52)
            touches.append(ContactTarget(f"{side}_instep", 0.3))
            touches.append(ContactTarget(f"{side}_thigh", 0.06, on="self", target=f"{side}_calf"))
        else:
            flex = rng.uniform(-2, 10)
            tucked = rng.random() < 0.5
            posture.leg(side, flex, 86 + flex, spread=0, apart=rng.uniform(3, 8))
            posture.ankle(side, point=-32 if tucked else 45).toes(side, 40 if tucked else 0)
            touches.append(ContactTarget(f"{side}_ball", 0.12) if tucked else ContactTarget(f"{side}_instep", 0.25))
        touches.append(ContactTarget(f"{side}_knee", 0.3))
    for side in _SIDES:
        if kind == "heels" or rng.random() < 0.3:
            if kind == "heels":
                touches += lay_hand_on_thigh(posture, side, rng)
            else:
                posture.arm(side, (0.18, -1, 0.32), (-0.08, -0.55, 1), (0, -1, 0)).fingers(side, 12, rng)
        else:
            _pose_free_arm(posture, side, rng)
    height = person.thigh + 0.08 if kind != "heels" else 0.24 * person.stature / 1.7
    return PosePlan("kneel", posture.pose, person.betas, (0.0, height, 0.0), touches=tuple(touches), balanced=False)


# ---- seated --------------------------------------------------------------------------------------------------------


def _seat_height(person: MeasuredBody, rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a seat height, at most the height of the knee hollow, except for some children."""
    usual = float(rng.uniform(low, high))
    hanging = person.stature < 1.45 and rng.random() < 0.4
    return usual if hanging else min(usual, max(0.25, knee_hollow_height(person)))


def knee_hollow_height(person: MeasuredBody) -> float:
    """Return the height of the knee hollow above the sole."""
    return person.shank - 0.06 * person.stature / 1.7


def _knees_free(person: MeasuredBody, front: float) -> float:
    """Return the smallest pelvis z at which the shanks clear a seat with its front edge at ``front``."""
    return front + 0.095 * person.stature / 1.7 - 0.96 * person.thigh


def seated_legs(
    posture: PoseBuilder, person: MeasuredBody, rng: np.random.Generator, seat: float
) -> tuple[ContactTarget, ...]:
    """Pose the legs of a person on a seat of height ``seat``, feet flat on the floor."""
    # The thigh falls or rises from the seat to where the knee is over flat feet.
    rise = np.clip((person.shank - seat - 0.055) / person.thigh, -0.5, 0.4)
    thigh = 90 + float(np.degrees(np.arcsin(rise)))
    spread = rng.uniform(4, 16)
    hanging = knee_hollow_height(person) < seat - 0.03
    for side in _SIDES:
        forward = rng.uniform(-5, 18)
        flex = thigh + rng.uniform(-2, 2)
        posture.leg(side, flex, flex - forward, spread=spread + rng.uniform(-3, 3))
        posture.foot(side, out=spread + rng.uniform(0, 8))
    carried = (ContactTarget("left_thigh", 0.3), ContactTarget("right_thigh", 0.3), ContactTarget("gluteus", 0.25))
    return carried if hanging else (*_soles(), *carried)


def _sitting_arms(posture: PoseBuilder, rng: np.random.Generator) -> tuple[ContactTarget, ...]:
    """Pose the arms of a sitting person."""
    kind = rng.choice(["thighs", "thighs", "mixed", "free"])
    touches: tuple[ContactTarget, ...] = ()
    for side in _SIDES:
        if kind == "thighs" or (kind == "mixed" and side == "left") or rng.random() < 0.25:
            touches += lay_hand_on_thigh(posture, side, rng)
        else:
            up = rng.uniform(-0.25, 0.5)
            posture.arm(side, (0.3, -1, 0.3), (rng.uniform(-0.15, 0.35), up, 1), (-0.7, -0.2, 0.2))
            posture.fingers(side, rng.uniform(10, 30), rng)
    return touches


def sit_on_stool(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person sitting on a stool or pouffe, soles on the floor."""
    seat = _seat_height(person, rng, 0.40, 0.50)
    blocks = furniture.stool(rng, (0.0, 0.0), rng.uniform(-0.2, 0.2), height=seat)
    posture = PoseBuilder((rng.uniform(-4, 8), 0, 0)).trunk(rng.uniform(2, 18), rng.uniform(-8, 8), rng.uniform(-3, 3))
    touches = seated_legs(posture, person, rng, seat)
    _turn_head(posture, rng)
    touches += _sitting_arms(posture, rng)
    pelvis = (0.0, seat + person.seat + 0.02, rng.uniform(-0.06, 0.0))
    return PosePlan("sit_on_stool", posture.pose, person.betas, pelvis, blocks, touches, drift=0.06)


def sit_on_chair(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person sitting on a chair: leaning back, upright or bent forward."""
    seat = _seat_height(person, rng, 0.43, 0.48)
    blocks = furniture.chair(rng, height=seat, depth=float(rng.uniform(0.40, 0.44)))
    half = blocks[4].half[2]
    kind = str(rng.choice(["back", "upright", "forward"]))
    lean = {"back": -rng.uniform(10, 15), "upright": rng.uniform(-3, 4), "forward": rng.uniform(12, 24)}[kind]
    bend = {"back": rng.uniform(2, 8), "upright": rng.uniform(2, 10), "forward": rng.uniform(12, 26)}[kind]
    posture = PoseBuilder((lean, 0, 0)).trunk(bend, rng.uniform(-7, 7))
    touches = seated_legs(posture, person, rng, seat)
    back = -half + person.behind + {"back": 0.02, "upright": 0.05, "forward": 0.07}[kind]
    if kind == "back":
        touches = (*touches, ContactTarget("back", 0.12, blocks=(5,)))
    if kind == "forward":
        for side in _SIDES:
            posture.arm(side, (0.28, -0.9, 0.55), (-0.35, -0.35, 0.9), (-0.6, -0.8, 0)).fingers(side, 18, rng)
            touches = (*touches, ContactTarget(f"{side}_forearm", 0.12, on="self", target=f"{side}_lap"))
        posture.head(-rng.uniform(10, 25), rng.uniform(-20, 20))
    else:
        _turn_head(posture, rng)
        touches += _sitting_arms(posture, rng)
    pelvis = (0.0, seat + person.seat + 0.02, max(float(back), _knees_free(person, half)))
    return PosePlan("sit_on_chair", posture.pose, person.betas, pelvis, blocks, touches, drift=0.05)


def sit_on_sofa(
    person: MeasuredBody, rng: np.random.Generator, x: float = 0.0, sofa: tuple[Block, ...] = ()
) -> PosePlan:
    """Plan a person leaning back on a sofa: on a new sofa, or at ``x`` on the given sofa."""
    seat = _seat_height(person, rng, 0.38, 0.43)
    recline = float(rng.uniform(0.20, 0.32))
    deep = min(float(rng.uniform(0.46, 0.53)), person.thigh + person.behind - 0.08)
    blocks = sofa or furniture.sofa(rng, height=seat, depth=deep, recline=recline)
    if sofa:
        seat, recline, deep = 2 * sofa[0].half[1], -sofa[1].pitch, 2 * sofa[0].half[2] - 0.1
    else:
        room = blocks[0].half[0] - 0.32
        x = float(rng.uniform(-room, room))
    lean = np.degrees(recline)
    posture = PoseBuilder((-lean - 9, 0, 0)).trunk(rng.uniform(0, 8), rng.uniform(-5, 5))
    touches = seated_legs(posture, person, rng, seat)
    posture.head(rng.uniform(10, 26), rng.uniform(-30, 30), rng.uniform(-5, 5))
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        beside = blocks[0].half[0] - sign * x
        if not sofa and beside < 0.42:  # the arm of the sofa is at hand
            posture.arm(side, (0.45, -0.85, 0.15), (0.12, -0.12, 1), (0, -1, 0)).fingers(side, 12, rng)
        else:
            touches += lay_hand_on_thigh(posture, side, rng)
    rest, free = -deep / 2 + person.behind + 0.01, _knees_free(person, deep / 2)
    pelvis = (x, seat + person.seat + 0.01, float(max(rest, free)))
    if free < rest + 0.12:
        touches = (*touches, ContactTarget("back", 0.10, blocks=(1,)), ContactTarget("upper_back", 0.04, blocks=(1,)))
    return PosePlan("sit_on_sofa", posture.pose, person.betas, pelvis, blocks, touches, drift=0.05)


def sit_on_bench(person: MeasuredBody, rng: np.random.Generator, x: float, bench: tuple[Block, ...]) -> PosePlan:
    """Plan a person sitting at ``x`` on a bench, upright or bent forward."""
    seat = bench[-1].centre[1] + bench[-1].half[1]
    posture = PoseBuilder((rng.uniform(-3, 10), 0, 0)).trunk(rng.uniform(4, 18), rng.uniform(-8, 8), rng.uniform(-3, 3))
    touches = seated_legs(posture, person, rng, seat)
    _turn_head(posture, rng)
    touches += _sitting_arms(posture, rng)
    pelvis = (x, seat + person.seat + 0.02, float(max(rng.uniform(-0.06, 0.0), _knees_free(person, bench[-1].half[2]))))
    return PosePlan("sit_on_bench", posture.pose, person.betas, pelvis, bench, touches, drift=0.04)


def sit_on_floor(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person sitting on the floor: legs stretched, knees drawn up, or cross-legged."""
    kind = str(rng.choice(["long", "knees", "crossed"]))
    seat = ContactTarget("gluteus", 0.2)
    size = person.stature / 1.7
    touches: list[ContactTarget] = [seat]
    if kind == "long":
        posture = PoseBuilder((-rng.uniform(14, 24), 0, 0)).trunk(rng.uniform(6, 16), rng.uniform(-5, 5))
        for side in _SIDES:
            bend = rng.uniform(4, 30)
            posture.leg(side, 88 + bend * 0.5, bend, spread=rng.uniform(4, 14)).ankle(side, point=rng.uniform(10, 30))
            posture.arm(side, (0.30, -0.85, -0.62), (0.22, -1.0, -0.18), (0.2, -1, 0.3), wrist=55)
            posture.fingers(side, 3, rng)
            touches += [ContactTarget(f"{side}_palm", 0.3), ContactTarget(f"{side}_heel", 0.12)]
    elif kind == "knees":
        posture = PoseBuilder((rng.uniform(-8, 0), 0, 0)).trunk(rng.uniform(22, 34), rng.uniform(-4, 4))
        for side in _SIDES:
            posture.leg(side, rng.uniform(122, 132), rng.uniform(108, 120), spread=rng.uniform(2, 9))
            posture.foot(side, out=5)
            touches.append(ContactTarget(f"{side}_sole", 0.5))
            posture.arm(side, (0.32, -0.75, 0.72), (-0.25, -0.10, 1), (-0.5, -0.9, 0)).fingers(side, 14, rng)
            touches.append(ContactTarget(f"{side}_palm", 0.10, on="self", target=f"{side}_knee"))
    else:
        posture = PoseBuilder((rng.uniform(-6, 2), 0, 0)).trunk(rng.uniform(12, 26), rng.uniform(-4, 4))
        first = str(rng.choice(_SIDES))
        for side in _SIDES:
            inner = side == first
            posture.leg(side, 80, 118 if inner else 104, spread=42, turn=62 if inner else 56)
            posture.ankle(side, point=25, roll=-15)
            touches.append(ContactTarget(f"{side}_foot_side", 0.12))
            posture.arm(side, (0.32, -1, 0.40), (0.10, -0.45, 1), (0, -1, 0)).fingers(side, 14, rng)
    _turn_head(posture, rng)
    pelvis = (0.0, 0.105 * size, 0.0)
    return PosePlan("sit_on_floor", posture.pose, person.betas, pelvis, touches=tuple(touches))


# ---- lying ---------------------------------------------------------------------------------------------------------


def lie(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person lying on a bed, a sofa or the floor, on the back or on one side."""
    place = str(rng.choice(["bed", "floor", "sofa"])) if person.stature < 1.80 else str(rng.choice(["bed", "floor"]))
    on_side = place != "sofa" and rng.random() < 0.35
    blocks: tuple[Block, ...] = ()
    level, pillow = 0.0, 0.0
    if place == "bed":
        blocks = furniture.bed(rng, pillow=float(rng.uniform(0.06, 0.08)) + (0.04 if on_side else 0.0))
        level = blocks[0].centre[1] + blocks[0].half[1]
        pillow = 2 * blocks[3].half[1]
    elif place == "sofa":
        blocks = furniture.sofa(rng, width=2.0, height=0.42, depth=0.58)
        level = 0.42
    if place != "bed" and (on_side or rng.random() < 0.6 or place == "sofa"):
        pillow = float(rng.uniform(0.05, 0.08)) + (0.05 if on_side else 0.0)
    plan = _lie_on_side(person, rng, pillow) if on_side else lie_on_back(person, rng, pillow)
    # From the pelvis to the middle of the head; somebody who lies on a side is curled up.
    head, front = (0.37 * person.stature, 0.0) if on_side else (0.40 * person.stature, 0.0)
    if place != "bed" and pillow:
        on = blocks[0].surface if blocks else "object"
        cushion = Block((front, level + pillow / 2, -head), (0.26, pillow / 2, 0.18), material="fabric", surface=on)
        blocks = (*blocks, cushion)
    if place == "sofa":
        carried = move_plan(plan, (0.0, 0.04), -np.pi / 2, level)
        # Head to +x: the room beside head and feet is shared.
        shift = blocks[0].half[0] - 0.12 - person.stature * 0.48
        cushion = replace(blocks[-1], centre=(head + shift, blocks[-1].centre[1], 0.04))
        x, y, z = carried.pelvis
        return replace(carried, pelvis=(x + shift, y, z), blocks=(*blocks[:-1], cushion))
    moved = 0.0 if place == "floor" else -blocks[0].half[2] + 0.22 + head
    shifted = move_plan(plan, (0.0, moved), 0.0, level)
    return replace(shifted, blocks=blocks)


def lie_on_back(person: MeasuredBody, rng: np.random.Generator, pillow: float) -> PosePlan:
    """Plan a person lying on the back."""
    posture = PoseBuilder((-90, 0, 0)).trunk(rng.uniform(-2, 3), 0)
    touches = [ContactTarget("back", 0.25), ContactTarget("gluteus", 0.2), ContactTarget("head_back", 0.10)]
    raised = str(rng.choice([*_SIDES, "", ""]))
    for side in _SIDES:
        if side == raised:
            # Thigh and shank counted from straight down: along the ground is 90.
            posture.leg(side, 132, 88, spread=rng.uniform(0, 6)).foot(side)
            touches.append(ContactTarget(f"{side}_sole", 0.5))
        else:
            posture.leg(side, 90, rng.uniform(1, 6), spread=rng.uniform(3, 9)).ankle(side, point=rng.uniform(10, 30))
            touches += [ContactTarget(f"{side}_calf", 0.10)]
        if rng.random() < 0.4:  # a hand on the belly
            posture.arm(side, (0.45, -0.20, 1), (-0.62, 0.42, 0.75), (0, -1, 0)).fingers(side, 10, rng)
        elif rng.random() < 0.25:  # an arm beside the head
            posture.arm(side, (1.0, 0.0, -0.25), (0.25, 0.0, -1), (0, 1, 0)).fingers(side, 15, rng)
        else:
            out = rng.uniform(0.25, 0.6)
            posture.arm(side, (out, -0.08, 1), (out * 0.6, 0.0, 1), (0, -1, 0)).fingers(side, 10, rng)
            touches.append(ContactTarget(f"{side}_palm", 0.10))
    posture.head(8 + 260 * pillow - 4, rng.uniform(-35, 35))
    height = 0.12 * person.stature / 1.7
    return PosePlan("lie", posture.pose, person.betas, (0.0, height, 0.0), touches=tuple(touches), drift=0.04)


def _lie_on_side(person: MeasuredBody, rng: np.random.Generator, pillow: float) -> PosePlan:
    """Plan a person lying on one side."""
    down = str(rng.choice(_SIDES))
    up = "right" if down == "left" else "left"
    sign = 1.0 if down == "left" else -1.0
    # First onto the back, head to -z, then rolled onto the side about the body's length.
    posture = PoseBuilder((0, 0, -sign * 84), (-90, 0, 0))
    frame = PoseBuilder((-90, 0, 0)).trunk(rng.uniform(8, 22))
    frame.leg(down, 90 + rng.uniform(10, 30), rng.uniform(25, 55))
    frame.leg(up, 90 + rng.uniform(35, 55), rng.uniform(60, 85), spread=-rng.uniform(13, 19))
    for side in _SIDES:
        frame.ankle(side, point=rng.uniform(10, 25))
    frame.arm(down, (-0.02, 1, -0.25), (0.0, 0.75, -1), (-1, 0, 0))
    frame.arm(up, (-0.45, 0.75, 0.45), (-1, 0.55, -0.25), (-1, -0.2, 0))
    for side in _SIDES:
        frame.fingers(side, 12, rng)
    frame.head(rng.uniform(5, 15), 0, -sign * (8 - 60 * pillow))
    root = posture.pose[0].copy()
    pose = frame.pose
    pose[0] = root
    touches = (
        ContactTarget(f"{down}_hip", 0.15),
        ContactTarget(f"{down}_leg_side", 0.15),
        ContactTarget(f"{down}_shoulder", 0.08),
        ContactTarget(f"{down}_temple", 0.06),
        ContactTarget(f"{up}_palm", 0.08),
    )
    height = 0.19 * person.stature / 1.7
    # The head comes forward of the pelvis, and shall be over the middle of the pillow.
    return PosePlan("lie", pose, person.betas, (-sign * 0.06, height, 0.0), touches=touches, drift=0.05)


# ---- leaning -------------------------------------------------------------------------------------------------------


def lean_on_wall(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person leaning on a wall with the back or a shoulder."""
    if rng.random() < 0.6:
        lean = rng.uniform(7, 13)
        posture = PoseBuilder((-lean, 0, 0)).trunk(rng.uniform(0, 8), rng.uniform(-4, 4))
        for side in _SIDES:
            posture.leg(side, lean + rng.uniform(4, 10), rng.uniform(2, 10), apart=rng.uniform(2, 6))
            posture.foot(side, out=rng.uniform(4, 14))
        _turn_head(posture, rng, nod=8)
        if rng.random() < 0.5:
            for side, high in zip(_SIDES, (0.12, -0.02), strict=True):
                posture.arm(side, (0.34, -1, 0.30), (-0.75, high, 0.66), (0, -1, 0.2)).fingers(side, 12, rng)
        else:
            for side in _SIDES:
                posture.arm(side, (0.22, -1, 0.12), (0.05, -1, 0.4), (-1, 0, -0.2)).fingers(side, 15, rng)
        blocks = furniture.wall(rng, (0.0, -person.behind - 0.02))
        touches = (
            *_soles(),
            ContactTarget("upper_back", 0.2, blocks=(0,)),
            ContactTarget("gluteus", 0.08, blocks=(0,)),
        )
        pelvis = (0.0, person.leg - 0.02, 0.0)
        return PosePlan("lean_on_wall", posture.pose, person.betas, pelvis, blocks, touches)
    side = str(rng.choice(_SIDES))
    other = "right" if side == "left" else "left"
    sign = 1.0 if side == "left" else -1.0
    lean = rng.uniform(6, 11)
    posture = PoseBuilder((0, 0, -sign * lean)).trunk(rng.uniform(0, 5), 0, 0)
    posture.leg(side, 0, 3, apart=-lean - 2).foot(side, out=6)
    posture.leg(other, rng.uniform(4, 10), rng.uniform(8, 16), apart=lean + 1).foot(other, out=8)
    posture.arm(side, (-0.10, -1, 0.32), (-0.45, -0.2, 0.8), (0, -1, 0)).fingers(side, 15, rng)
    _pose_free_arm(posture, other, rng)
    posture.head(4, -sign * rng.uniform(0, 30), -sign * rng.uniform(0, 8))
    top = person.shoulder * np.sin(np.radians(lean)) + 0.24 * person.stature / 1.7
    blocks = furniture.wall(rng, (sign * float(top), 0.0), -sign * np.pi / 2)
    touches = (*_soles(), ContactTarget(f"{side}_shoulder", 0.3, blocks=(0,)))
    azimuth = (-70.0, 15.0) if side == "left" else (-15.0, 70.0)
    pelvis = (0.0, person.leg, 0.0)
    return PosePlan("lean_on_wall", posture.pose, person.betas, pelvis, blocks, touches, azimuth=azimuth)


def lean_on_table(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person bent forward with both hands on a table."""
    size = person.stature / 1.7
    height = float(rng.uniform(0.71, 0.77)) if size > 0.85 else float(rng.uniform(0.5, 0.58))
    lean = rng.uniform(20, 34)
    posture = PoseBuilder((lean, 0, 0)).trunk(rng.uniform(4, 14), rng.uniform(-5, 5))
    for side in _SIDES:
        posture.leg(side, rng.uniform(-6, 2), rng.uniform(2, 8), apart=rng.uniform(3, 7)).foot(
            side, out=rng.uniform(3, 12)
        )
    posture.head(-lean * 0.7 + rng.uniform(-5, 20), rng.uniform(-25, 25))
    bend = np.radians(lean + 8)
    shoulder = np.array([0.0, person.leg + person.shoulder * np.cos(bend), person.shoulder * np.sin(bend)])
    drop = float(shoulder[1] - height - 0.05)
    ahead = float(np.sqrt(max(0.02, (0.96 * person.arm) ** 2 - drop**2)))
    hands = shoulder[2] + min(ahead, 0.28)
    edge = hands - rng.uniform(0.06, 0.10)
    depth = float(rng.uniform(0.65, 0.8))
    blocks = furniture.table(rng, (0.0, float(edge) + depth / 2), depth=depth, height=height)
    touches = [*_soles()]
    reaches = []
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        out = rng.uniform(0.20, 0.30) * size
        down = np.array([out - 0.17 * size, height + 0.05 - shoulder[1], hands - shoulder[2]])
        posture.arm(
            side, (down[0] + 0.06, down[1], down[2] - 0.08), (down[0], down[1], down[2] + 0.06), (0, -1, 0.4), wrist=55
        )
        posture.fingers(side, 3, rng)
        touches.append(ContactTarget(f"{side}_palm", 0.35, blocks=(0,)))
        reaches.append(PositionTarget(f"{side}_palm", (sign * float(out), height, float(hands) + 0.07), 0.05))
    pelvis = (0.0, person.leg - 0.01, 0.0)
    return PosePlan("lean_on_table", posture.pose, person.betas, pelvis, blocks, tuple(touches), tuple(reaches))


# ---- steps and slopes ----------------------------------------------------------------------------------------------


def climb_step(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person with one foot on a step and the other on the floor."""
    blocks = furniture.stairs(rng, (0.0, 0.0), steps=int(rng.integers(2, 5)))
    rise = 2 * blocks[0].half[1]
    going = 2 * (blocks[1].centre[2] - blocks[0].centre[2])
    step = 2 if rng.random() < 0.4 and person.stature > 1.55 else 1
    lead = str(rng.choice(_SIDES))
    rear = "right" if lead == "left" else "left"
    sign = 1.0 if lead == "left" else -1.0
    posture = PoseBuilder((rng.uniform(4, 9), 0, 0)).trunk(rng.uniform(2, 10), sign * rng.uniform(-6, 0))
    flex = 38 + 24 * step + rng.uniform(-4, 4)
    posture.leg(lead, flex, flex * 1.1, spread=2).foot(lead, out=rng.uniform(2, 8))
    posture.leg(rear, rng.uniform(-8, -2), rng.uniform(4, 12), apart=2).foot(rear, out=rng.uniform(2, 10))
    posture.head(rng.uniform(2, 22), rng.uniform(-15, 15))
    for side, ahead in ((lead, -1), (rear, 1)):
        swing = ahead * rng.uniform(0.15, 0.4)
        posture.arm(side, (0.22, -1, swing), (0.0, -1, swing + rng.uniform(0.3, 0.9)), (-1, 0, 0))
        posture.fingers(side, rng.uniform(12, 30), rng)
    tread = going * (step - 0.5) + rng.uniform(-0.02, 0.05)
    size = person.stature / 1.7
    reaches = (
        PositionTarget(f"{lead}_sole", (sign * 0.09 * size, rise * step, float(tread)), 0.04),
        PositionTarget(f"{rear}_sole", (-sign * 0.09 * size, 0.0, float(-0.15 * size - rng.uniform(0.0, 0.08))), 0.04),
    )
    touches = (ContactTarget(f"{lead}_sole", 0.45, blocks=(step - 1,)), ContactTarget(f"{rear}_sole", 0.55, blocks=()))
    pelvis = (0.0, person.leg - 0.02, -0.10 * size)
    return PosePlan("climb_step", posture.pose, person.betas, pelvis, blocks, touches, reaches, balanced=True)


def steps_outside(rng: np.random.Generator) -> tuple[Block, ...]:
    """Return wide stone steps that rise towards -z, with the lowest front edge at the origin."""
    rise, going = float(rng.uniform(0.14, 0.17)), float(rng.uniform(0.32, 0.38))
    return furniture.stairs(rng, yaw=np.pi, steps=5, rise=rise, going=going, width=3.2, material="stone")


def sit_on_steps(person: MeasuredBody, rng: np.random.Generator, blocks: tuple[Block, ...], x: float) -> PosePlan:
    """Plan a person sitting on the third step at ``x``, feet two steps lower."""
    rise = 2 * blocks[0].half[1]
    going = 2 * abs(blocks[1].centre[2] - blocks[0].centre[2])
    seat, edge = 3 * rise, -2 * going
    posture = PoseBuilder((rng.uniform(-4, 8), 0, 0)).trunk(rng.uniform(10, 24), rng.uniform(-6, 6))
    spread = rng.uniform(5, 14)
    touches = [ContactTarget("gluteus", 0.2, blocks=(2,))]
    reaches = []
    sole = 0.5 * going * rng.uniform(0.9, 1.2)
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        posture.leg(side, 98 + rng.uniform(-3, 3), 92, spread=spread).foot(side, out=spread)
        touches.append(ContactTarget(f"{side}_sole", 0.45, blocks=(0,)))
        reaches.append(PositionTarget(f"{side}_sole", (x + sign * 0.14, rise, float(-going + sole)), 0.05))
        posture.arm(side, (0.25, -1, 0.6), (-0.25, -0.3, 1), (-0.7, -0.7, 0)).fingers(side, 18, rng)
        touches.append(ContactTarget(f"{side}_forearm", 0.12, on="self", target=f"{side}_lap"))
    _turn_head(posture, rng, nod=-8)
    pelvis = (x, seat + person.seat + 0.01, edge - 0.10)
    return PosePlan("sit_on_steps", posture.pose, person.betas, pelvis, blocks, tuple(touches), tuple(reaches))


def stand_on_steps(
    person: MeasuredBody, rng: np.random.Generator, blocks: tuple[Block, ...], x: float, step: int
) -> PosePlan:
    """Plan a person standing on one step; step 0 is the ground in front."""
    going = 2 * abs(blocks[1].centre[2] - blocks[0].centre[2])
    plan = stand(person, rng)
    z = 0.35 if step == 0 else -(step - 0.5) * going
    lift = 2 * blocks[0].half[1] * step
    plan = move_plan(plan, (x, z - 0.03 * person.stature / 1.7), float(np.radians(rng.uniform(-8, 8))), lift)
    touches = tuple(replace(touch, share=0.45, blocks=(step - 1,) if step else ()) for touch in plan.touches)
    return replace(plan, action="stand", blocks=blocks, touches=touches, drift=0.05)


# ---- behind things -------------------------------------------------------------------------------------------------


def sit_behind_table(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person sitting at a table that often hides the legs, with hands on its top."""
    plan = sit_on_chair(person, rng)
    depth = float(rng.uniform(0.6, 0.8))
    seat = plan.blocks[4].centre[1] + plan.blocks[4].half[1]
    height = max(seat + 0.27, float(rng.uniform(0.71, 0.77)))
    edge = plan.pelvis[2] + person.behind + rng.uniform(0.05, 0.10)
    panel = rng.random() < 0.75
    desk = furniture.table(rng, (0.0, float(edge) + depth / 2), depth=depth, height=height, panel=bool(panel))
    top = len(plan.blocks)
    size = person.stature / 1.7
    posture = PoseBuilder((rng.uniform(0, 8), 0, 0)).trunk(rng.uniform(6, 18), rng.uniform(-5, 5))
    touches = list(seated_legs(posture, person, rng, seat))
    _turn_head(posture, rng)
    reaches = []
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        if rng.random() < 0.8:
            posture.arm(side, (0.30, -1, 0.62), (rng.uniform(-0.45, -0.1), 0.04, 1), (0, -1, 0)).fingers(side, 8, rng)
            touches += [
                ContactTarget(f"{side}_palm", 0.2, blocks=(top,)),
                ContactTarget(f"{side}_forearm", 0.12, blocks=(top,)),
            ]
            reaches.append(
                PositionTarget(f"{side}_palm", (sign * 0.16 * size, height, float(edge) + 0.20 * size), 0.08)
            )
        else:
            posture.arm(side, (0.35, -0.9, 0.55), (-0.1, 0.9, 0.6), (-0.5, 0, 1)).fingers(side, 20, rng)
    return replace(
        plan,
        action="sit_behind_table",
        pose=posture.pose,
        blocks=(*plan.blocks, *desk),
        touches=tuple(touches),
        reaches=tuple(reaches),
    )


def stand_behind_counter(person: MeasuredBody, rng: np.random.Generator) -> PosePlan:
    """Plan a person standing behind a closed counter, one or both hands on its top."""
    posture = PoseBuilder((rng.uniform(2, 8), 0, 0)).trunk(rng.uniform(2, 12), rng.uniform(-6, 6))
    _upright_legs(posture, rng)
    _turn_head(posture, rng, nod=8)
    size = person.stature / 1.7
    height = float(np.clip(person.leg + 0.08 * size + rng.uniform(-0.06, 0.06), 0.70, 1.08))
    edge = person.behind + rng.uniform(0.04, 0.10)
    depth = float(rng.uniform(0.45, 0.65))
    blocks = furniture.counter(rng, (0.0, float(edge) + depth / 2), depth=depth, height=height)
    hands = _SIDES if rng.random() < 0.6 else (str(rng.choice(_SIDES)),)
    touches, reaches = [*_soles()], []
    for side, sign in zip(_SIDES, (1, -1), strict=True):
        if side in hands:
            drop = float(np.clip((person.leg + person.shoulder - height) / person.arm, 0.3, 0.95))
            posture.arm(side, (0.42, -1, 0.1 - 0.3 * (1 - drop)), (-0.05, -0.75 * drop, 0.9), (0, -1, 0), wrist=25)
            posture.fingers(side, 4, rng)
            touches.append(ContactTarget(f"{side}_palm", 0.3, blocks=(0,)))
            reaches.append(
                PositionTarget(f"{side}_palm", (sign * 0.24 * size, height, float(edge) + 0.12 * size), 0.08)
            )
        else:
            _pose_free_arm(posture, side, rng)
    pelvis = (0.0, person.leg - 0.005, 0.0)
    return PosePlan(
        "stand_behind_counter", posture.pose, person.betas, pelvis, blocks, tuple(touches), tuple(reaches), drift=0.05
    )


SOLO_ACTIONS: dict[str, Callable[[MeasuredBody, np.random.Generator], PosePlan]] = {
    "stand": stand,
    "walk": walk,
    "sit_on_chair": sit_on_chair,
    "sit_on_sofa": sit_on_sofa,
    "sit_on_stool": sit_on_stool,
    "sit_on_floor": sit_on_floor,
    "lie": lie,
    "lean_on_wall": lean_on_wall,
    "lean_on_table": lean_on_table,
    "kneel": kneel,
    "squat": squat,
    "climb_step": climb_step,
    "sit_behind_table": sit_behind_table,
    "stand_behind_counter": stand_behind_counter,
}
"""Action name -> function that plans it for one person."""
