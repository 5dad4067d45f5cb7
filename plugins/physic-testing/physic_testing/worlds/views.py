"""Worlds that several cameras show at the same moment: their names, and their cameras.

Each view is a world of its own, with its own photo and camera. People, room and light are the same
in all of them; ``World.camera`` puts their truth into one frame, that of the room.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.cameras import CameraShot, RoomCamera, find_camera

if TYPE_CHECKING:
    from physic_core.types import FloatArray
    from physic_testing.worlds.cameras import PhotoSubjects

__all__ = ["VIEWS", "CameraShots", "find_views", "split_name", "view_names"]

VIEWS = 8
"""Number of cameras of a world with several views."""

_MARK = "+view"
_LEAST_ANGLE = 15.0  # degrees about the people between any two cameras
_DRAWS = 12  # of a camera, before the angle between cameras may be smaller by a third


@dataclass(frozen=True)
class CameraShots:
    """Camera poses and intrinsics of all views."""

    shots: tuple[CameraShot, ...]


def view_names(name: str, count: int = VIEWS) -> tuple[str, ...]:
    """Return the names of the worlds that show one moment from ``count`` cameras.

    The cameras are 15 to 180 degrees apart about the people, less only where walls or furniture
    leave no other place.

    Args:
        name: of a world, such as "sit_on_chair"; the seed is chosen as for any world.
        count: of cameras, at most VIEWS.
    """
    if not 1 <= count <= VIEWS:
        raise ValueError(f"a world has 1 to {VIEWS} views, got {count}")
    return tuple(f"{name}{_MARK}{view}" for view in range(count))


def split_name(name: str) -> tuple[str, int | None]:
    """Return the name of a world without its view, and the view; None for a world of one camera."""
    base, mark, view = name.rpartition(_MARK)
    return (base, int(view)) if mark and view.isdecimal() else (name, None)


def find_views(
    subject: PhotoSubjects,
    rng: np.random.Generator,
    size: tuple[int, int],
    first: CameraShot,
    *,
    outdoors: bool,
) -> CameraShots:
    """Draw the other cameras of a world with several views; all of them show everybody.

    Args:
        subject: people and furniture.
        rng: random generator.
        size: width and height of the photos, px.
        first: camera of view 0.
        outdoors: whether larger distances are allowed.

    Raises:
        RuntimeError: no camera at any angle shows everybody.
    """
    middle = subject.sparse.reshape(-1, 3).mean(axis=0)
    shots = [first]
    least = _LEAST_ANGLE
    while len(shots) < VIEWS:
        for _ in range(_DRAWS):
            shot = find_camera(
                subject, rng, size, (-180.0, 180.0), may_cut=first.cut, outdoors=outdoors
            )
            if shot is None:
                raise RuntimeError("No camera shows everybody.")
            if min(_angle(shot.camera, other.camera, middle) for other in shots) >= least:
                shots.append(shot)
                break
        else:
            least *= 2 / 3
    return CameraShots(tuple(shots))


def _angle(one: RoomCamera, two: RoomCamera, middle: FloatArray) -> float:
    """Return the angle about the vertical between two cameras, seen from the people, degrees."""
    (x0, z0), (x1, z1) = ((camera.position - middle)[[0, 2]] for camera in (one, two))
    return float(np.degrees(abs(np.arctan2(x0 * z1 - z0 * x1, x0 * x1 + z0 * z1))))
