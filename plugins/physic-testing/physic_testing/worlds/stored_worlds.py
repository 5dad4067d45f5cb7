"""Worlds of the conformance kit whose scenes and photos ship with the package, so that nothing is
shaded for them.

``tools/store_worlds.py`` writes them; all else of a world is computed from its scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_core.files.plain import read_value
from physic_core.types import Intrinsics
from physic_testing.worlds.action_scenes import ActionPose
from physic_testing.worlds.cameras import RoomCamera
from physic_testing.worlds.dents import Dent
from physic_testing.worlds.rooms import Room, Walls
from physic_testing.worlds.scene_setup import StagedScene
from physic_testing.worlds.solids import Block, Ground
from physic_testing.worlds.textures import Decoration, Patch

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

__all__ = ["StoredWorld", "file_of", "load_stored"]


@dataclass(frozen=True)
class StoredWorld:
    """What takes long to find and to shade.

    Attributes:
        stage: scene and camera.
        pictures: (B,) PNG of the photo, and below it the photo without people minus it, modulo 256.
    """

    stage: StagedScene
    pictures: UInt8Array

    @property
    def images(self) -> tuple[UInt8Array, UInt8Array]:
        """The photos (H, W, 3) with and without people."""
        import cv2

        both = cv2.imdecode(self.pictures, cv2.IMREAD_UNCHANGED)
        photo, difference = np.split(np.asarray(both, np.uint8), 2)
        return photo, photo + difference


def file_of(name: str, seed: int, size: tuple[int, int]) -> Path:
    """Return the file of a world, whether or not it is stored."""
    return Path(__file__).with_name("-".join(map(str, (name, seed, *size))) + ".npz")


def load_stored(name: str, seed: int, size: tuple[int, int]) -> StoredWorld | None:
    """Return a stored world; None for all others.

    Raises:
        DamagedFileError: the file is damaged.
    """
    file = file_of(name, seed, size)
    scene = (
        StagedScene,
        ActionPose,
        RoomCamera,
        Intrinsics,
        Room,
        Walls,
        Dent,
        Ground,
        Block,
        Patch,
        Decoration,
    )
    found: StoredWorld | None = read_value(file, (StoredWorld, *scene)) if file.exists() else None
    return found
