"""Shares of mistakes in what outputs are off by, and photos that are changed with all that belongs
to them.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.body.joints import JOINT_NAMES
from physic_testing.conformance.cases import build_case
from physic_testing.conformance.changes import CHANGES, change_of, changed_case
from physic_testing.conformance.readings import share_of
from physic_testing.conformance.truth import embedded_surface, mirrored_order
from physic_testing.worlds.world import project

RNG = np.random.default_rng(0)
MISTAKE = [RNG.normal(size=40) for _ in range(12)]
ERRORS = [RNG.normal(size=40) for _ in range(12)]


@pytest.mark.parametrize(("made", "wanted"), [(0, 0.0), (1, 1.0), (0.5, 0.5)])
def test_the_share_of_a_mistake_is_found_among_other_errors(made: float, wanted: float):
    share = share_of([made * m + e for m, e in zip(MISTAKE, ERRORS, strict=True)], MISTAKE)
    assert share.mean == pytest.approx(wanted, abs=share.margin)
    assert 0.1 < share.margin < 0.5


def test_a_mistake_alone_is_surely_found_and_two_units_tell_nothing():
    share = share_of(MISTAKE, MISTAKE)
    assert (share.mean, share.margin, share.left) == pytest.approx((1, 0, 0), abs=1e-9)
    assert share_of(MISTAKE[:2], MISTAKE[:2]) is None
    assert share_of(ERRORS, [0 * m for m in MISTAKE]) is None


@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_photo_shows_the_changed_bodies_keypoints_and_points(name: str):
    case = build_case("several people", (160, 120))
    change = change_of(case, name)
    other = changed_case(case, change)
    assert other.photo.shape[:2] == (change.camera.height, change.camera.width)
    order = mirrored_order(JOINT_NAMES[:22]) if change.mirrors else list(range(22))
    before, after = (
        project(embedded_surface(one.bodies)[1][:, :22], one.intrinsics) for one in (case, other)
    )
    np.testing.assert_allclose(after, change.of_pixels(before)[:, order], atol=0.3)
    rows, columns = np.nonzero(other.scene.valid)
    pixels = project(other.scene.points[rows, columns].astype(np.float64), other.intrinsics)
    assert np.abs(pixels - np.stack([columns, rows], axis=1)).max() < 1.1
