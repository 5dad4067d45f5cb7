"""Groups of photos in ``physic batch``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from physic_core.errors import InputError
from physic_scene.output import MOMENT_FILE, moment_json
from physic_scene.scene import ScenePipeline

if TYPE_CHECKING:
    from physic_core import Config, Reconstruction
    from physic_core.batch.moments import MomentPhoto


def join_photos(photos: Sequence[MomentPhoto], config: Config) -> tuple[Reconstruction, dict[str, bytes]]:
    """Return the result of one moment from the results of its photos alone, and the content of ``moment.json``.

    Args:
        photos: in the order of the table; known statures are those of the first, and ages are those of each.
        config: that has made their results.

    Raises:
        InputError: some photos alone have ages, there are too few or too many photos, or fewer than two show the same
            people.
        PhysicError: the reference photo cannot be reconstructed.
    """
    with_age, without = ([p.name for p in photos if bool(p.settings.get("age")) is known] for known in (True, False))
    if with_age and without:
        raise InputError(
            f"ages are given for {', '.join(with_age)}, but not for {', '.join(without)}: give them in each row of the "
            "moment, in the order of its photo, 0 where unknown"
        )
    statures = photos[0].settings.get("stature") or ()
    with ScenePipeline(config) as scene:
        joined = scene.join([photo.result for photo in photos], [photo.name for photo in photos], statures=statures)
    return joined.reconstruction, {MOMENT_FILE: moment_json(joined).encode()}
