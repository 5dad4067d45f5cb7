"""What a hand holds has the depth of the hand in the scene; nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import reconstruct
from physic_core.body.joints import JOINT_INDEX
from physic_core.types.skeletons import SIDES
from physic_mock.pixels import MockSegmenter
from tests.pipeline.mocks import changed

pytestmark = [pytest.mark.kernels, pytest.mark.usefixtures("few_steps")]


def holding(side):
    """A change of what a segmenter finds: a thing in the left upper corner, in a hand of the first
    person.
    """

    def hold(people, image):
        held = np.zeros((len(people), 2, *image.shape[:2]), bool)
        held[0, side, :8, :12] = True
        return replace(people, held=held)

    return changed(MockSegmenter, hold)


@pytest.fixture(scope="module")
def plain(few_steps, world):
    """The result of the same photo, in which nobody holds anything."""
    return reconstruct(world.image, "mock")


@pytest.mark.parametrize("side", [0, 1])
def test_only_the_pixels_of_a_held_thing_move_to_the_hand(world, plain, side):
    result = reconstruct(world.image, "mock", backends=holding(side))
    thing = np.zeros(world.image.shape[:2], bool)
    thing[:8, :12] = True
    hand = result.people[0].joints[JOINT_INDEX[f"{SIDES[side]}_middle1"]]
    assert result.scene.valid[thing].all()
    np.testing.assert_allclose(result.scene.points[thing][:, 2], hand[2], rtol=1e-5)
    np.testing.assert_array_equal(result.scene.colors[thing], world.image[thing])
    camera = result.intrinsics
    rows, columns = np.nonzero(thing)
    x, y, z = result.scene.points[thing].T
    np.testing.assert_allclose(camera.fx * x / z + camera.cx, columns, atol=1e-3)
    np.testing.assert_allclose(camera.fy * y / z + camera.cy, rows, atol=1e-3)
    for name in ("points", "valid", "colors", "normals"):
        before, after = (getattr(one.scene, name)[~thing] for one in (plain, result))
        np.testing.assert_array_equal(after, before)
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)
    np.testing.assert_array_equal(result.people[0].contact, plain.people[0].contact)
