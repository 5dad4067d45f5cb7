"""Textured bodies: the photo's colours where it shows the body, a marked fill elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import ExportRequest
from physic_core.errors import InputError
from physic_core.export import export_frame
from physic_export.skins import textured_skins
from physic_visual.textures.dressed import dressed_bodies


def request_of(result):
    frame = export_frame(result.scene.floor, "y")
    people = tuple(range(len(result.people)))
    return ExportRequest(result, people, frame, "a", ".glb", options={"skin": "photo"})


def test_a_body_has_the_colour_of_the_photo_where_it_is_seen(result):
    """Masks in which each person has one colour, apart from a stripe over their middle."""
    image = result.image.copy()
    colors = ([200, 30, 30], [20, 40, 220])
    for person, color in zip(result.people, colors, strict=True):
        image[person.mask] = color
    textured = textured_skins(request_of(replace(result, image=image)), 256)
    for index, color in enumerate(colors):
        picture, filled = textured.photo_images(index)
        assert 0.15 < dressed_bodies(textured.request.result).people[index].shown_share < 0.5
        assert (filled < 128).any()
        assert (filled > 128).any()
        np.testing.assert_allclose(picture[filled == 0], np.tile(color, ((filled == 0).sum(), 1)))
        # What the photo does not show is filled with colours of the same person.
        assert np.abs(picture.astype(int) - color).max() <= 3
        assert np.abs(textured.vertex_colors(index).astype(int) - color).max() <= 3


def test_bodies_of_another_mesh_have_no_texture(result):
    person = replace(result.people[0], vertices=result.people[0].vertices[:100])
    with pytest.raises(InputError, match="13348 vertices"):
        textured_skins(request_of(replace(result, people=(person,))), 128)
