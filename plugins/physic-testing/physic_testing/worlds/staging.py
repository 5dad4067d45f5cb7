"""Puts an action into a place and aims the camera at it.

The room's frame (x right, y up, z towards the camera's side, ground through the origin), metres.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds import storage
from physic_testing.worlds.cameras import Camera, Shot, Subject, aim
from physic_testing.worlds.environments import indoors, outdoors
from physic_testing.worlds.performance import Actor, Performance, perform
from physic_testing.worlds.settling import pose_body
from physic_testing.worlds.solids import Block, Ground

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray, Intrinsics
    from physic_testing.worlds.rooms import Room

__all__ = ["Stage", "set_stage"]

_TAKES = 12
_SCENERY = (
    "archive",
    "cameras",
    "casting",
    "clothes",
    "environments",
    "labels",
    "rendering",
    "rooms",
    "staging",
    "storage",
    "textures",
    "truth",
    "worlds",
)
"""Modules that no performance depends on."""


@dataclass(frozen=True)
class Stage:
    """A place with its people and its camera."""

    room: Room
    actors: tuple[Actor, ...]
    camera: Camera
    intrinsics: Intrinsics


def set_stage(model: BodyModel, name: str, seed: int, size: tuple[int, int]) -> Stage:
    """Perform an action until a camera finds everybody, and furnish the place.

    Args:
        model: the body.
        name: of the action.
        seed: draws everything.
        size: width and height of the photo, px.

    Raises:
        RuntimeError: no camera sees everybody, however often the action is performed.
    """
    for take in range(_TAKES):
        # Each matter has its own numbers, so that another photo size does not change the people.
        act, look, place = (
            np.random.default_rng([seed, zlib.crc32(name.encode()), take, matter]) for matter in range(3)
        )
        performance = storage.kept(
            storage.key_of("performance", name, seed, take, without=_SCENERY),
            Performance,
            (Actor, Block, Ground),
            lambda act=act: perform(name, model, act),  # type: ignore[misc]
        )
        posed = [pose_body(model, a.pose, a.betas, a.transl) for a in performance.actors]
        vertices, joints = (np.stack(part) for part in zip(*posed, strict=True))
        subject = Subject(vertices, joints, model.faces.numpy(), performance.blocks, performance.ground)
        shot = aim(
            subject,
            look,
            size,
            performance.azimuth,
            may_cut=performance.fills == "upper",
            outdoors=performance.outdoors,
        )
        if shot is not None:
            room = _furnished(performance, subject.sparse, shot, place)
            return Stage(room, performance.actors, shot.camera, shot.intrinsics)
    raise RuntimeError(f"No camera sees everybody of the world {name!r}, seed {seed}, at {size[0]} x {size[1]} px.")


def _furnished(performance: Performance, people: FloatArray, shot: Shot, rng: np.random.Generator) -> Room:
    seed = int(rng.integers(1 << 30))
    if performance.outdoors:
        return outdoors(people, performance.blocks, performance.ground, shot, rng, seed)
    return indoors(people, performance.blocks, shot, rng, seed)
