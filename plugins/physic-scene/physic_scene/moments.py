"""Groups of photos in ``physic batch``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from physic_scene.output import MOMENT_FILE, moment_json
from physic_scene.scene import Scene

if TYPE_CHECKING:
    from physic_core import Config, Reconstruction
    from physic_core.batch.moments import MomentPhoto

__all__ = ["join_photos"]


def join_photos(photos: Sequence[MomentPhoto], config: Config) -> tuple[Reconstruction, dict[str, bytes]]:
    """Return the result of one moment from the results of its photos alone, and the content of ``moment.json``.

    Args:
        photos: in the order of the table; known statures are those of the first.
        config: that has made their results.

    Raises:
        InputError: there are too few or too many photos, or fewer than two show the same people.
        PhysicError: the reference photo cannot be reconstructed.
    """
    statures = photos[0].settings.get("stature") or ()
    with Scene(config) as scene:
        joined = scene.join([photo.result for photo in photos], [photo.name for photo in photos], statures=statures)
    return joined.reconstruction, {MOMENT_FILE: moment_json(joined).encode()}
