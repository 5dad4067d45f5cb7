"""Worlds that ship with the package are those that their code builds."""

from __future__ import annotations

import numpy as np
import pytest

from physic_testing.conformance.cases import EVIDENCE, build_case
from physic_testing.worlds import disk_cache, stored_worlds
from physic_testing.worlds import world as worlds


@pytest.mark.parametrize("case", ["odd size", *EVIDENCE])
def test_the_ordinary_photos_of_the_kit_are_stored(case: str):
    world = build_case(case).truth
    stored = stored_worlds.load_stored(
        world.name, world.seed, (world.intrinsics.width, world.intrinsics.height)
    )
    assert stored is not None
    for stored_image, image in zip(stored.images, (world.image, world.empty_image), strict=True):
        np.testing.assert_array_equal(stored_image, image)


def test_a_stored_world_is_the_built_one(monkeypatch: pytest.MonkeyPatch):
    ask = worlds._cached_world.__wrapped__
    asked = ("stand", 1, (131, 97))
    monkeypatch.setenv(disk_cache.FOLDER_VARIABLE, "off")
    stored = ask(*asked)
    monkeypatch.setattr(stored_worlds, "load_stored", lambda *_: None)
    built = ask(*asked)
    assert (stored.room, stored.intrinsics, stored.action) == (
        built.room,
        built.intrinsics,
        built.action,
    )
    for name in (
        "depth",
        "empty_depth",
        "masks",
        "surfaces",
        "vertices",
        "joints",
        "contact",
        "distance",
    ):
        np.testing.assert_array_equal(getattr(stored, name), getattr(built, name), err_msg=name)
    for name in ("image", "empty_image"):  # other libraries for rays differ at single edges
        assert (getattr(stored, name) != getattr(built, name)).mean() < 1e-3, name
