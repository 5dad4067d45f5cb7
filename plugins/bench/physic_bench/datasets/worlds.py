"""The synthetic worlds of metricbody-testing, whose bodies, contact, scene and camera are known.

ROOT is a folder for their photos: a new one, or that of an earlier call. The preset "mock" answers
from the truth of a world, with errors where its options say so; frames are the names of the worlds.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from physic_bench.cameras import Camera
from physic_bench.data_files import write_picture
from physic_bench.datasets.base import DataSet, FrameSet
from physic_bench.types import BenchPerson, Frame, Picture, Truth
from physic_core.body import JOINT_NAMES
from physic_testing.metrics import hidden_by_depth_map, scene_distance
from physic_testing.worlds import WORLDS, load_world

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from physic_bench.bodies import BodyFiles
    from physic_core.types import Float64Array
    from physic_testing.worlds import World


def missing(root: Path, with_pictures: bool) -> list[str]:
    """Return that nothing is missing."""
    return []


def frames(root: Path, choose: Callable[[list[str]], list[str]], bodies: BodyFiles) -> FrameSet:
    """Return the worlds, each a sequence of its own, and write their photos."""
    return FrameSet(tuple(_world_frame(root, name) for name in choose(list(WORLDS))))


def _world_frame(root: Path, name: str) -> Frame:
    world = load_world(name)
    path = root / f"{name}.png"
    write_picture(path, world.image)
    size = (world.intrinsics.width, world.intrinsics.height)
    camera = Camera(world.intrinsics.matrix.astype(np.float64), *size)
    return Frame(name, name, partial(_truth_of_world, name), camera, Picture(path))


def _truth_of_world(name: str) -> Truth:
    world = load_world(name)
    mesh = world.topology
    people = tuple(
        BenchPerson(str(i), joints, JOINT_NAMES, "of the world", vertices, mesh, contact, mesh)
        for i, (joints, vertices, contact) in enumerate(
            zip(world.joints, world.vertices, world.contact, strict=True)
        )
    )
    return Truth(people, partial(_distance_to_world, world), world.floor.normal, world.floor.offset)


def _distance_to_world(world: World, points: Float64Array) -> Float64Array:
    """Return the signed distance (N,) m of points (N, 3) m to the scene that the photo would show
    without people; 0 for points inside that the scene hides.
    """
    empty = world.points(people=False)
    is_known = np.asarray(np.isfinite(empty).all(-1))
    distance = scene_distance(
        points, empty, world.empty_normals, is_known, world.intrinsics, world.floor
    )
    hidden = hidden_by_depth_map(points, world.empty_depth, world.intrinsics)
    return np.where(hidden & (distance < 0), 0.0, distance)


DATA_SET = DataSet("worlds", __doc__, missing, frames)
