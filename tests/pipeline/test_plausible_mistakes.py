"""Results of backends that the interface allows and the photo contradicts: the backend is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import reconstruct
from physic_mock import backends
from physic_testing.worlds import load_world
from tests.pipeline.mocks import changed

pytestmark = pytest.mark.usefixtures("few_steps")


def mistaken(kind, field, change):
    """A class like a mock, one field of whose results is changed."""
    return changed(
        kind,
        lambda found, *_: replace(found, **{field: np.float32(change(getattr(found, field)))}),
    )


DEPTH = backends.MockMetricDepth, "depth"
POINTS = backends.MockKeypointDetector, "points"
UNCACHED = {"extends": "mock", "run": {"cache": False}}


@pytest.fixture(scope="module")
def walk():
    return load_world("walk", (160, 120))


BODIES = backends.MockBodyEstimator
FAR_FROM_OTHERS = [
    mistaken(*POINTS, lambda points: points + np.array([0, 10])),
    changed(
        BODIES,
        lambda bodies, *_: replace(
            bodies,
            parameters=replace(
                bodies.parameters,
                global_orient=bodies.parameters.global_orient * np.float32([1, 0, 0]),
            ),
        ),
    ),
    changed(
        backends.MockPersonObserver,
        lambda said, *_: replace(said, child=np.full_like(said.child, 0.95), child_share=0.1),
    ),
    changed(backends.MockRelativePointmap, lambda pointmap, *_: replace(pointmap, up=-pointmap.up)),
    mistaken(*DEPTH, lambda z: 1.6 * z),
    mistaken(
        backends.MockPersonObserver, "touch", lambda touch: touch[:, [2, 3, 0, 1, *range(4, 10)]]
    ),
]


@pytest.mark.parametrize("wrong", FAR_FROM_OTHERS)
def test_a_backend_that_never_passed_the_kit_is_named_where_a_mark_is_lower(wrong, walk):
    """Children with the height of adults, a shift, a mirrored body, a roof for a floor, a scale,
    and hands for feet, of which no check fails.
    """
    (interface,) = wrong
    found = reconstruct(walk.image, UNCACHED, backends=wrong)
    assert any(f"{interface} '" in one for one in found.warnings), found.warnings


@pytest.mark.parametrize(
    ("wrong", "words", "check", "placed"),
    [
        (mistaken(*DEPTH, lambda z: 1000 * z), "is its unit millimeters", "depth_scale", 1),
        (mistaken(*DEPTH, lambda z: z[:, ::-1]), "mirrored", "depth_order", 0),
    ],
)
def test_a_plausible_mistake_is_a_warning_that_names_the_backend(
    world, wrong, words, check, placed
):
    found = reconstruct(world.image, "mock", backends=wrong)
    (interface,) = wrong
    (warning,) = (text for text in found.warnings if words in text)
    assert f"{interface} '" in warning
    assert [one.name for one in found.checks if one.failed and one.person is None] == (
        [check] if check else []
    )
    assert found.usable["place"] == placed  # a depth of another scale than people is not followed
