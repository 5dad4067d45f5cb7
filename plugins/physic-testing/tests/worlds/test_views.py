"""Worlds that several cameras show at the same moment: one truth in one room, and a photo for each
camera.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from physic_core.errors import InputError
from physic_testing.worlds import OTHER_BODIES, VIEWS, build_world, is_world, view_names

SIZE = (96, 72)


@pytest.fixture(scope="module")
def views():
    return [build_world(name, 4, SIZE) for name in view_names("hug", 4)]


def test_all_views_have_the_same_people_and_room(views):
    first = views[0]
    in_room = first.camera.to_room(first.joints.astype(np.float64))
    for view in views[1:]:
        assert view.camera.to_room(view.joints.astype(np.float64)) == pytest.approx(
            in_room, abs=1e-5
        )
        assert np.array_equal(view.contact, first.contact)
        assert view.room == first.room
        assert view.parameters.betas == pytest.approx(first.parameters.betas)


def test_the_cameras_are_at_least_15_degrees_apart_about_the_people(views):
    middle = views[0].camera.to_room(views[0].joints.astype(np.float64)).mean(axis=(0, 1))
    at = [np.arctan2(*(view.camera.position - middle)[[0, 2]]) for view in views]
    turns = [abs((a - b + np.pi) % (2 * np.pi) - np.pi) for a, b in itertools.combinations(at, 2)]
    assert np.degrees(min(turns)) > 15


def test_each_view_shows_everybody_where_its_camera_is(views):
    for view in views:
        assert view.masks.any(axis=(1, 2)).all()
        pelvis = view.keypoints["coco17"][:, 11:13].mean(axis=1)
        centre = np.array(
            [[np.flatnonzero(mask.any(axis=axis)).mean() for axis in (0, 1)] for mask in view.masks]
        )
        assert np.linalg.norm(pelvis - centre, axis=1).max() < 0.5 * SIZE[0]
    assert not np.array_equal(views[0].image, views[1].image)


def test_names_of_views_are_names_of_worlds():
    assert view_names("stand", 2) == ("stand+view0", "stand+view1")
    assert is_world(f"stand{OTHER_BODIES}+view7")
    assert not is_world(f"stand+view{VIEWS}")
    assert not is_world("stand+view")
    with pytest.raises(InputError, match="There is no world named 'stand\\+view9'"):
        build_world("stand+view9", 0, SIZE)
    with pytest.raises(ValueError, match="a world has 1 to 8 views, got 9"):
        view_names("stand", 9)
