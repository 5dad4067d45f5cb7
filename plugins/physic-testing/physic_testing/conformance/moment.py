"""Moments of the conformance kit: each case as a world that three cameras show, with its true people and cameras."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import MomentView
from physic_testing.worlds import build_world
from physic_testing.worlds.views import split_name, view_names

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.conformance.cases import Case
    from physic_testing.worlds import World

VIEWS = 3
"""Photos of a moment."""


def moment_worlds(case: Case) -> tuple[World, ...]:
    """Return the world of a case, as each of its cameras shows it."""
    world = case.truth
    names = view_names(split_name(world.name)[0], VIEWS)
    return tuple(build_world(name, world.seed, (world.image.shape[1], world.image.shape[0])) for name in names)


def build_moment(case: Case) -> tuple[MomentView, ...]:
    """Return the photos of a moment with their true people, keypoints, bodies, cameras and floors.

    A photo without ground truth, such as a blank one, is the first of three.
    """
    from physic_testing.conformance.cases import build_case, case_of_world

    if case.world is not None:
        return tuple(_view(case_of_world(world.name, world)) for world in moment_worlds(case))
    others = [case_of_world(world.name, world) for world in moment_worlds(build_case("one person"))[1:]]
    return tuple(_view(one) for one in (case, *others))


def true_cameras(case: Case, reference: int) -> tuple[FloatArray, FloatArray]:
    """Return the true rotations (V, 3, 3) and translations (V, 3), metres, in the frame of a reference camera."""
    cameras = [world.camera for world in moment_worlds(case)]
    base = cameras[reference]
    rotation = np.stack([camera.rotation @ base.rotation.T for camera in cameras])
    moved = [camera.rotation @ (base.position - camera.position) for camera in cameras]
    return rotation, np.stack(moved)


def _view(case: Case) -> MomentView:
    joints = None if case.world is None else case.world.joints
    return MomentView(
        name=case.name,
        image=case.photo,
        intrinsics=case.intrinsics,
        people=case.people,
        keypoints=case.keypoints,
        bodies=replace(case.bodies, joints=joints),
        statures=np.full(len(case.people), np.nan),
        floor=None if case.world is None else case.world.floor,
    )
