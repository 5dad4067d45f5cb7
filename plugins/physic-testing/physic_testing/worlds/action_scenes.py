"""Posed scenes: people with their furniture, chosen from a file, turned and mirrored at random.

``action_scenes.npz`` has 457 scenes with 580 people, in three pools without common scenes. They
were drawn once, by ``draw_action`` of ``physic_testing/worlds`` at commit 573d7e2d, which fitted
poses to contacts. Of 494 scenes 32 were left out, whose errors were larger than 1.5 (in one action
1.7) times its tolerances: depth 8 mm, gap 15 mm, crossing 20 mm; and 5 with feet on the ground
below a bar. The scenes of OTHER_BODIES keep the seed of their body. Lengths are in steps of 0.1 mm,
angles of 0.1 mrad, shapes of 0.001: vertices are off by 0.1 mm. The room's frame (x right, y up, z
towards the camera's side, ground through the origin), metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from physic_core.body.joints import JOINT_NAMES
from physic_testing.worlds.children import with_children
from physic_testing.worlds.furniture import move_blocks
from physic_testing.worlds.other_bodies import other_body
from physic_testing.worlds.posing import rest_body
from physic_testing.worlds.reproducible_math import apply, round_to_grid
from physic_testing.worlds.solids import Block, Ground, yaw_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["POOLS", "ActionPose", "ActionScene", "load_action"]

POOLS = ("confirmation", "development", "choice")
"""What the pool of posed scenes of a seed is for, by the remainder of the seed divided by 3."""

_STEP = 1e-4
_SHAPE_STEP = 1e-3
_WITH_CHILDREN = -1  # in place of the seed of other bodies; 0 are those of the body model
_MIRRORED = [
    JOINT_NAMES.index(name.replace("left", "?").replace("right", "left").replace("?", "right"))
    for name in JOINT_NAMES
]


@dataclass(frozen=True)
class ActionPose:
    """A posed person.

    Attributes:
        pose: (55, 3) rotation vectors, radians.
        betas: (K,) shape.
        transl: (3,) metres.
        action: name of the action.
    """

    pose: FloatArray
    betas: FloatArray
    transl: FloatArray
    action: str


@dataclass(frozen=True)
class ActionScene:
    """People and furniture of an action, around the origin.

    Attributes:
        model: body model of the people.
        actors: the people.
        blocks: furniture that supports or hides them, and small objects that they hold.
        ground: ground plane.
        outdoors: whether the scene is outdoors.
        azimuth: range of camera directions, degrees, 0 from +z, 90 from +x.
        fills: "whole" if the camera must show full bodies, "upper" if it may crop or hide legs.
    """

    model: BodyModel
    actors: tuple[ActionPose, ...]
    blocks: tuple[Block, ...]
    ground: Ground
    outdoors: bool
    azimuth: tuple[float, float]
    fills: str


def load_action(name: str, model: BodyModel, pool: str, rng: np.random.Generator) -> ActionScene:
    """Choose a posed scene, turn it about the vertical and mirror it, both at random.

    Args:
        name: of the world, without a view.
        model: embedded body in float64.
        pool: one of POOLS.
        rng: random generator.
    """
    file = _file()
    scenes = file["scenes"]
    row = int(rng.choice(np.flatnonzero((scenes["name"] == name) & (scenes["pool"] == pool))))
    scene = scenes[row]
    sign = float(rng.choice([-1.0, 1.0]))
    turn = float(rng.uniform(-np.pi, np.pi))
    if scene["body"] == _WITH_CHILDREN:
        model = with_children(model)
    elif scene["body"]:
        model = other_body(model, np.random.default_rng(int(scene["body"])))
    people, blocks = (table[table["scene"] == row] for table in (file["people"], file["blocks"]))
    low, high = sorted(sign * float(end) for end in scene["azimuth"])
    x, y, z = apply(yaw_matrix(turn), scene["normal"] * (sign, 1, 1)).tolist()
    return ActionScene(
        model=model,
        actors=tuple(_actor(model, person, sign, turn) for person in people),
        blocks=move_blocks((_block(block, sign) for block in blocks), (0.0, 0.0), turn),
        ground=Ground((x, y, z), str(scene["ground"])),
        outdoors=bool(scene["outdoors"]),
        azimuth=(low + float(np.degrees(turn)), high + float(np.degrees(turn))),
        fills=str(scene["fills"]),
    )


@cache
def _file() -> dict[str, NDArray[Any]]:
    """Return the tables of scenes, people and blocks."""
    with np.load(Path(__file__).with_name("action_scenes.npz")) as file:
        return dict(file)


def _actor(model: BodyModel, person: Any, sign: float, turn: float) -> ActionPose:
    """Return a person, mirrored where the sign is -1, then turned by an angle in radians."""
    pose = person["pose"] * _STEP
    if sign < 0:
        pose = pose[_MIRRORED] * (1, -1, -1)
    room = yaw_matrix(turn)
    pose[0] = (Rotation.from_matrix(room) * Rotation.from_rotvec(pose[0])).as_rotvec()
    betas = person["betas"][: model.num_betas] * _SHAPE_STEP
    pelvis = apply(room, person["pelvis"] * _STEP * (sign, 1, 1))
    transl = pelvis - rest_body(model, betas)[1][0]
    return ActionPose(round_to_grid(pose), betas, round_to_grid(transl), str(person["action"]))


def _block(block: Any, sign: float) -> Block:
    """Return a block, mirrored where the sign is -1."""
    x, y, z = (block["centre"] * _STEP * (sign, 1, 1)).tolist()
    a, b, c = (block["half"] * _STEP).tolist()
    return Block(
        (x, y, z),
        (a, b, c),
        yaw=sign * float(block["yaw"]) * _STEP,
        material=str(block["material"]),
        pitch=float(block["pitch"]) * _STEP,
        surface=str(block["surface"]),
        rounding=float(block["rounding"]) * _STEP,
        soft=float(block["soft"]) * _STEP,
        item=str(block["item"]),
    )
