"""Set-up of a world: action scene, camera and surroundings.

The room's frame (x right, y up, z towards the camera's side, ground through the origin), metres.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import Intrinsics
from physic_testing.worlds import disk_cache
from physic_testing.worlds.action_scenes import POOLS, ActionPose, ActionScene, load_action
from physic_testing.worlds.cameras import CameraShot, PhotoSubjects, RoomCamera, find_camera
from physic_testing.worlds.posing import pose_body
from physic_testing.worlds.surroundings import build_outdoor_place, build_room
from physic_testing.worlds.views import CameraShots, find_views

if TYPE_CHECKING:
    from collections.abc import Sequence

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray
    from physic_testing.worlds.rooms import Room

__all__ = ["StagedScene", "set_up_scene"]

_ATTEMPTS = 12


@dataclass(frozen=True)
class StagedScene:
    """A room or outdoor place with posed people and a camera.

    Attributes:
        first_camera: that of view 0, which the light depends on; ``camera`` in a world of one
            camera.
    """

    room: Room
    actors: tuple[ActionPose, ...]
    camera: RoomCamera
    intrinsics: Intrinsics
    first_camera: RoomCamera


def set_up_scene(
    model: BodyModel, name: str, seed: int, size: tuple[int, int], view: int | None = None
) -> tuple[BodyModel, StagedScene]:
    """Choose action scenes until a camera shows everybody, then build the surroundings; return them
    with their body.

    Args:
        model: embedded body in float64.
        name: name of the world, without a view.
        seed: seed of all random choices.
        size: width and height of the photo, px.
        view: number of the camera in a world with several views; None in a world of one camera.

    Raises:
        RuntimeError: no camera shows everybody in any of the chosen action scenes.
    """
    for take in range(_ATTEMPTS):
        # Each matter has its own numbers, so that another photo size does not change the people.
        act, look, place = (
            np.random.default_rng([seed, zlib.crc32(name.encode()), take, matter])
            for matter in range(3)
        )
        action_scene = load_action(name, model, POOLS[seed % len(POOLS)], act)
        posed = [
            pose_body(action_scene.model, a.pose, a.betas, a.transl) for a in action_scene.actors
        ]
        vertices, joints = (np.stack(part) for part in zip(*posed, strict=True))
        subject = PhotoSubjects(
            vertices, joints, model.faces.numpy(), action_scene.blocks, action_scene.ground
        )
        shot = find_camera(
            subject,
            look,
            size,
            action_scene.azimuth,
            may_cut=action_scene.fills == "upper",
            outdoors=action_scene.outdoors,
        )
        if shot is not None:
            shots: tuple[CameraShot, ...] = (shot,)
            if view is not None:
                shots = disk_cache.load_or_build(
                    disk_cache.cache_key("views", name, seed, *size),
                    CameraShots,
                    (CameraShot, RoomCamera, Intrinsics),
                    lambda: find_views(subject, look, size, shot, outdoors=action_scene.outdoors),  # noqa: B023
                ).shots
            own = shots[view or 0]
            room = _build_surroundings(action_scene, subject.sparse, shots, place)
            stage = StagedScene(room, action_scene.actors, own.camera, own.intrinsics, shot.camera)
            return action_scene.model, stage
    raise RuntimeError(
        f"No camera sees everybody of the world {name!r}, seed {seed}, at {size[0]} x {size[1]} px."
    )


def _build_surroundings(
    action_scene: ActionScene,
    people: FloatArray,
    shots: Sequence[CameraShot],
    rng: np.random.Generator,
) -> Room:
    """Build the room or the outdoor place of an action scene."""
    seed = int(rng.integers(1 << 30))
    if action_scene.outdoors:
        return build_outdoor_place(
            people, action_scene.blocks, action_scene.ground, shots, rng, seed
        )
    return build_room(people, action_scene.blocks, shots, rng, seed)
