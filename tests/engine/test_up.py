"""Up is what the surest witness says, and a floor follows it where they agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from physic_core.engine.up import (
    Up,
    angle_deg,
    level_plane,
    slope_sigma,
    slope_warnings,
    surest_up,
    up_checked_by_people,
    up_of_camera_axis,
)
from physic_core.geometry.floor import PlaneFit
from physic_core.types import SurfaceLabels

FEET = torch.tensor([0.1, 0.4, 1.0], dtype=torch.float64)
NOWHERE = torch.zeros(2, 2, dtype=torch.bool)


def looking_down(degrees):
    """The up vector of a camera that looks down."""
    angle = math.radians(degrees)
    return torch.tensor([0.0, -math.cos(angle), -math.sin(angle)], dtype=torch.float64)


def floor(pitch, sigma=6.0):
    wide = math.radians(sigma)
    normal = looking_down(pitch)
    return PlaneFit(normal, 1.5, NOWHERE, 1.0, 0.0, "labels", pitch_sigma=wide, plane_sigma=wide)


def edges(pitch, sigma=1.5):
    return Up(looking_down(pitch), sigma, "edges")


def place_of_feet(plane):
    return FEET * plane.offset / -(FEET @ plane.normal)


def test_a_floor_that_agrees_turns_to_the_surer_witness_about_the_feet():
    plane = floor(14)
    level = level_plane(plane, edges(9), 0.5, FEET)
    assert angle_deg(level.normal, looking_down(9)) < 0.5
    assert torch.allclose(place_of_feet(level), place_of_feet(plane))
    assert math.degrees(level.pitch_sigma) < 1.6
    assert level.plane_sigma == plane.plane_sigma
    assert slope_warnings(level, edges(9), 0.5) == ()


def test_a_witness_that_is_less_sure_than_floors_are_turns_none_and_may_contradict_one():
    plane = floor(9)
    assert level_plane(plane, edges(20, 7.0), 0.0, FEET) is plane
    assert slope_warnings(plane, edges(20, 7.0), 0.0) == ()
    far = level_plane(plane, edges(40, 7.0), 0.0, FEET)
    assert torch.equal(far.normal, plane.normal)
    assert math.degrees(far.pitch_sigma) > 30


def test_the_farther_a_witness_is_off_the_less_it_moves_a_floor():
    moves = [
        angle_deg(level_plane(floor(9), edges(9 + off, 6.5), 0.0, FEET).normal, looking_down(9))
        for off in (4, 20)
    ]
    assert 1 < moves[0] < 2.5
    assert moves[1] < 3.5


def test_a_floor_that_contradicts_up_stays_and_is_less_sure():
    plane = floor(33)
    same = level_plane(plane, edges(5), 0.5, FEET)
    assert torch.equal(same.normal, plane.normal)
    assert same.offset == plane.offset
    assert math.degrees(same.pitch_sigma) > 28
    assert "28 degrees" in slope_warnings(same, edges(5), 0.5)[0]


def test_a_street_may_slope_and_a_floor_may_not():
    room = SurfaceLabels(np.ones((4, 4), np.uint8), ("unknown", "floor"))
    street = SurfaceLabels(np.ones((4, 4), np.uint8), ("unknown", "ground"))
    level, slope = slope_sigma(room), slope_sigma(street)
    assert level < 1 < slope == pytest.approx(slope_sigma(None), abs=0.01)
    turned = [level_plane(floor(14), edges(9), sigma, FEET) for sigma in (level, slope)]
    of_room, of_street = (angle_deg(plane.normal, looking_down(9)) for plane in turned)
    assert of_room < 1 < of_street


@pytest.mark.parametrize(
    ("plane", "up", "pitch", "sigma"),
    [
        (None, None, 0.0, up_of_camera_axis().sigma),
        (None, edges(20), 20.0, 1.5),
        (None, edges(40, 21.0), 40.0, 21.0),
        (None, edges(5, 40.0), 0.0, up_of_camera_axis().sigma),
        (floor(12), None, 12.0, 6.0),
        (floor(9, 6.0), edges(5, 40.0), 9.0, 6.0),
        (floor(33), edges(5), 5.0, 6.9),
        (floor(33, 24.0), edges(5, 7.0), 5.0, 7.0),
    ],
    ids=[
        "the camera",
        "edges",
        "edges of a steep view",
        "the camera against unsure edges",
        "the floor",
        "the floor against unsure edges",
        "edges against the floor",
        "a floor that is a guess",
    ],
)
def test_the_surest_witness_tells_up(plane, up, pitch, sigma):
    found = surest_up(plane, up, 0.0)
    assert angle_deg(found.direction, looking_down(pitch)) < 1e-5
    assert found.sigma == pytest.approx(sigma, abs=0.1)


def test_a_steep_view_that_looks_level_has_the_up_of_its_floor():
    steep = floor(49, 8.0)
    for plane in (steep, level_plane(steep, edges(15, 7.0), 0.0, FEET)):
        found = surest_up(plane, edges(15, 7.0), 0.0)
        assert angle_deg(found.direction, looking_down(49)) < 1e-5
        assert 20 < found.sigma < 34  # contains what the look differs by


@pytest.mark.parametrize("sigma", [4.0, 8.0, 12.0])
def test_edges_that_are_15_degrees_from_the_floor_are_reported_whichever_wins(sigma):
    tilted = edges(20, sigma)
    found = surest_up(floor(-2, 6.6), tilted, 0.5)
    assert "22 degrees" in slope_warnings(floor(-2, 6.6), tilted, 0.5)[0]
    assert found.sigma > 6.6
    if found.source == "the floor":
        assert 2 * found.sigma > 22
    assert slope_warnings(floor(6, 6.6), edges(20, 12.0), 0.5) == ()


def bodies(*leans):
    """The planes of people before the camera who lean sideways, degrees."""
    angles = np.radians(leans)
    return torch.from_numpy(np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1))


@pytest.mark.parametrize(
    ("leans", "low", "high", "said"),
    [((1, -2, 0, 3), 1.5, 2.5, 0), ((40, 43, 38), 30.0, 45.0, 1), ((), 1.5, 1.5, 0)],
)
def test_people_who_stand_leave_an_error_to_up_that_they_contradict(leans, low, high, said):
    found, warnings = up_checked_by_people(edges(5), bodies(*leans))
    assert low <= found.sigma <= high
    assert len(warnings) == said
    assert found.direction.equal(looking_down(5))
