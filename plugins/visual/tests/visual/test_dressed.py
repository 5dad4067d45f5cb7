"""People in the photo's colours where it shows them, and in guessed clothes elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from physic_visual.textures.dressed import dressed_bodies, dressed_images

PINK = np.array([230, 20, 200])


@pytest.fixture(scope="module")
def pink(result):
    """A photo whose people are pink."""
    image = result.image.copy()
    for person in result.people:
        image[person.mask] = PINK
    return replace(result, image=image)


def saturation(colors):
    return np.ptp(colors.astype(int), axis=-1)


def test_a_body_has_the_photo_s_colour_where_it_is_seen_and_a_darker_guess_of_it_elsewhere(
    pink,
):
    dressed = dressed_bodies(pink)
    images = dressed_images(pink)
    assert set(dressed.people) == set(images) == {0, 1}
    for index, person in enumerate(pink.people):
        mesh = person.mesh()
        away = (mesh.vertex_normals * mesh.vertices).sum(1) / np.linalg.norm(mesh.vertices, axis=1)
        body = dressed.people[index]
        colors = body.colors.astype(int)
        assert 0.1 < body.shown_share < (away < 0).mean()  # no photo shows what faces away
        assert (np.abs(colors - PINK).max(1) < 3).mean() > 0.1
        guess = colors[away > 0.3]
        assert body.guessed_share[away > 0.3].min() == 1
        assert_allclose(guess / guess.max(1, keepdims=True) - PINK / 230, 0, atol=0.03)
        assert guess[:, 0].max() < 0.92 * PINK[0]
        assert np.ptp(guess[:, 0]) > 30  # with a light
        assert saturation(images[index]).max() > 200


def test_a_person_whom_no_photo_shows_is_gray(result):
    person = replace(result.people[0], mask=np.zeros_like(result.people[0].mask))
    dressed = dressed_bodies(replace(result, people=(person,))).people[0]
    assert dressed.shown_share == 0
    assert saturation(dressed.colors).max() < 15
    assert np.ptp(dressed.colors[:, 0]) > 30  # with a light


def test_bodies_without_texture_coordinates_have_colours_of_vertices(pink):
    other = replace(pink, body_model="smplx")
    dressed = dressed_bodies(other)
    assert dressed.mesh is None
    assert not dressed_images(other)
    assert saturation(dressed.people[0].colors).min() > 60


def test_who_has_no_body_has_no_colours(result):
    person = result.people[0]
    lost = replace(person, vertices=person.vertices * np.nan, joints=person.joints * np.nan)
    assert set(dressed_bodies(replace(result, people=(lost, result.people[1]))).people) == {1}
    assert not dressed_bodies(replace(result, people=())).people
