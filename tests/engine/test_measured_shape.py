"""A measured depth gives a relative point map its shape where it is known, and its trend
elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.engine.scene.measured_shape import shows_people, with_measured_shape
from physic_core.engine.sizes.evidence import is_inverse
from physic_core.types import DepthMap, Intrinsics

from .seen import pointmap_of, rays_of

CAMERA = Intrinsics.from_focal(200, 160, 120)
ROWS, COLUMNS = np.mgrid[:120, :160]
WALL = 2 + 3 * (1 - ROWS / 120) + 0.2 * np.sin(COLUMNS / 20)
RAMP = np.linspace(1, 1.1, 160)[None]


def pointmap(depth, unknown="inverse_scale_shift"):
    return pointmap_of(depth, CAMERA, unknown, shift_sigma=0.1)


def measured(depth):
    return DepthMap(np.asarray(depth, np.float32), None, 0.01)


@pytest.mark.parametrize("unknown", ["scale", "scale_shift", "inverse_scale_shift"])
def test_the_shape_is_that_of_the_measured_depth(unknown):
    truth = WALL * RAMP
    found = with_measured_shape(pointmap(1 / (0.7 / WALL + 0.1), unknown), measured(truth), CAMERA)
    assert np.abs(found.points[..., 2] / truth - 1).max() < 0.0101
    assert np.median(found.points[..., 2] / truth) == pytest.approx(1, abs=0.002)
    assert (found.unknown, found.shift_sigma) == ("scale", None)
    on_rays = rays_of(CAMERA) * found.points[..., 2:]
    assert found.points == pytest.approx(on_rays, abs=1e-4)


def test_steps_of_a_coarse_sensor_are_smoothed():
    coarse = WALL[ROWS // 2 * 2, COLUMNS // 2 * 2]
    found = with_measured_shape(pointmap(WALL / 3), measured(coarse), CAMERA)
    steps, given = (np.abs(np.diff(z, 2, axis=0)).max() for z in (found.points[..., 2], coarse))
    assert steps < 0.5 * given


def test_the_trend_continues_where_the_depth_is_unknown():
    truth = WALL * RAMP
    known = np.where((ROWS > 40) & (ROWS < 80) & (COLUMNS > 60) & (COLUMNS < 100), np.nan, truth)
    found = with_measured_shape(pointmap(WALL / 3, "scale"), measured(known), CAMERA)
    assert np.abs(found.points[..., 2] / truth - 1).max() < 0.015


def test_a_depth_shows_people_or_the_scene_behind_them():
    masks = np.zeros((1, 120, 160), bool)
    masks[0, 30:100, 60:90] = True
    with_person = np.where(masks[0], 2.0, WALL + 1)
    photo = pointmap(with_person * np.where(masks[0], 1.1, 1))
    scene = pointmap(WALL + 1)
    assert shows_people(measured(with_person), photo, scene, masks)
    assert not shows_people(measured(WALL + 1), photo, scene, masks)


def test_a_disparity_is_told_from_a_depth():
    assert is_inverse(measured(30 / WALL), pointmap(WALL))
    assert not is_inverse(measured(WALL * RAMP), pointmap(WALL))
