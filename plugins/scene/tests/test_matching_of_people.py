"""Who is who in two and three photos: by the energy of the cameras and by clothes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.types import Plane
from physic_scene.checks import SolvedView, checks_of_cameras
from physic_scene.person_matching import match_pair
from physic_scene.rigid import CameraPose

from .photos import photo

MIDDLE = np.array([0.0, 0.0, 4.0])
TURN = Rotation.from_euler("y", 40, degrees=True).as_matrix()
HALF_TURN = Rotation.from_euler("y", 180, degrees=True).as_matrix()


@pytest.fixture
def facing_each_other():
    """Return two photos of two people who face each other, and the motion between the cameras."""
    rng = np.random.default_rng(5)
    body = rng.normal(0, [0.2, 0.5, 0.2], (55, 3))
    body[0] = 0
    person = body + np.array([0.8, 0, 0])
    joints = np.stack([person, person @ HALF_TURN.T]) + MIDDLE
    motion = CameraPose(TURN, MIDDLE - TURN @ MIDDLE)
    return photo(joints), photo(motion.to_camera(joints)), motion


def in_clothes(people, *colours):
    """Return people in clothes of these colours; NaN where the photo shows none."""
    return replace(
        people, colours=np.broadcast_to(np.array(colours)[:, None, None], people.colours.shape)
    )


@pytest.mark.parametrize("swapped", [False, True])
def test_clothes_tell_people_apart_who_face_each_other(facing_each_other, swapped):
    one, two, _ = facing_each_other
    order = [1, 0] if swapped else [0, 1]
    found = match_pair(in_clothes(one, 20, 60), in_clothes(two, *np.array([20, 60])[order]))
    assert sorted(found.pairs) == list(enumerate(order))
    odds = found.odds[:, order]
    assert np.diag(odds).min() > 10
    assert odds[[0, 1], [1, 0]].max() < -10


def verdict(*views, rows):
    """Return the values of each check over the photos."""
    found = {}
    for check in checks_of_cameras(views, np.array(rows)):
        found.setdefault(check.name, []).append(check.value)
    return found


@pytest.fixture
def solved_views(facing_each_other):
    """Return both photos with their true cameras, and the floor 1.5 m under the first one."""
    one, two, motion = facing_each_other
    down = Plane(np.array([0.0, -1.0, 0.0]), 1.5)
    views = [
        SolvedView(name, people, pose, people.K, (120, 90), down)
        for name, people, pose in (("a.png", one, CameraPose.identity()), ("b.png", two, motion))
    ]
    return [replace(view, people=in_clothes(view.people, 20, 60)) for view in views]


def test_people_who_are_not_the_same_person_disagree(solved_views):
    found = verdict(*solved_views, rows=[[0, 1], [1, 0]])
    assert min(found["view_agreement"]) > 28


def test_a_camera_with_an_empty_place_where_a_person_is_fails_its_check(solved_views):
    a, b = solved_views
    per_photo = ("K", "focal_sigma", "skeleton", "up", "pose")
    rows = {name: rows[:1] for name, rows in vars(b.people).items() if name not in per_photo}
    found = verdict(a, replace(b, people=replace(b.people, **rows)), rows=[[0, 0]])
    assert found["view_people"] == [1, 1]
    assert found["view_missing_person"] == [0, 1]


def test_cameras_of_different_heights_over_one_floor_disagree(solved_views):
    a, b = solved_views
    found = verdict(a, replace(b, floor=replace(b.floor, offset=0.5)), rows=[[0, 0], [1, 1]])
    assert found["view_height"] == pytest.approx([np.log(3), np.log(3)])
    assert verdict(a, replace(b, floor=None), rows=[[0, 0], [1, 1]])["view_height"] == [None, None]
