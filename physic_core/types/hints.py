"""Results of earlier backends as optional inputs of later ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.types.arrays import BoolArray, UInt8Array
    from physic_core.types.bodies import Bodies
    from physic_core.types.camera import Intrinsics
    from physic_core.types.depth import Plane, Pointmap, SceneScale
    from physic_core.types.people import Keypoints, People


@dataclass(frozen=True)
class Hints(ShortRepr):
    """Known facts about the photo when a backend is called, all optional; a backend may ignore them.

    Attributes:
        intrinsics: camera, if the user, the file or an earlier backend gave it.
        people: of the original photo.
        keypoints: of the original photo.
        hole: (H, W) bool, inpainted pixels of the given image.
        scene: relative point map of the inpainted photo.
        original: relative point map of the original photo, aligned to ``scene`` outside the people.
        floor: floor plane in the units of ``scene``.
        scale: of ``scene``, by everything of known size that the photo shows; for a metric depth that reads it.
        bodies: in metres, not yet placed in the scene, of the configured body model. ``joints`` are given if that model
            is a file of the user's, which no backend can load.
        photo: (H, W, 3) uint8 RGB, the original photo, if the given image is inpainted.
    """

    intrinsics: Intrinsics | None = None
    people: People | None = None
    keypoints: Keypoints | None = None
    hole: BoolArray | None = None
    scene: Pointmap | None = None
    original: Pointmap | None = None
    floor: Plane | None = None
    scale: SceneScale | None = None
    bodies: Bodies | None = None
    photo: UInt8Array | None = None
