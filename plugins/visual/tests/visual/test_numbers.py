"""The numbers of people and the names of surfaces in pictures."""

from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw

from physic_core.types import BodyContact, ContactPartner
from physic_visual.numbers import draw_numbers, free_places, surfaces_in_photo
from physic_visual.palette import person_color

SIZE = (200, 100)
DISC_PX = 22


def centers(places, taken=()):
    page = Image.new("RGB", SIZE)
    draw_numbers(ImageDraw.Draw(page), (0, 0), places, SIZE, taken)
    pixels = np.asarray(page)
    found = {}
    for index in places:
        rows, columns = np.nonzero((pixels == person_color(index)).all(2))
        found[index] = np.array([columns.mean(), rows.mean()])
    return found


def test_numbers_of_people_in_one_place_do_not_cover_each_other():
    found = list(centers({0: (90.0, 50.0), 1: (92.0, 51.0), 2: (90.0, 50.0)}).values())
    for i, one in enumerate(found):
        for other in found[:i]:
            assert np.abs(one - other).max() >= DISC_PX


def test_names_of_surfaces_in_one_place_do_not_cover_each_other():
    places = {f"unnamed surface {i}": (150.0 + i, 60.0) for i in range(4)}
    found = free_places(places, dict.fromkeys(places, 50.0), 17.0, (200, 100))
    rows = sorted(row for _, row in found.values())
    assert np.diff(rows).min() >= 17
    assert 0 < rows[0] < rows[-1] < 100
    assert {column for column, _ in found.values()} == {150.0}


def test_a_number_leaves_a_taken_box_free():
    x, y = centers({0: (20.0, 20.0)}, [(0.0, 0.0, 60.0, 40.0)])[0]
    assert x > 60 + DISC_PX / 2 - 1 or y > 40 + DISC_PX / 2 - 1


def test_a_number_stays_in_the_picture():
    x, y = centers({0: (-50.0, 400.0)})[0]
    assert DISC_PX / 2 <= x <= SIZE[0] - DISC_PX / 2
    assert DISC_PX / 2 <= y <= SIZE[1] - DISC_PX / 2


def test_a_surface_without_a_name_has_its_number_where_it_is_touched(make):
    result = make()
    unnamed = ContactPartner("scene", id=3)
    person = result.people[0]
    touched = person.vertices[:1]
    partner = np.where(np.arange(len(person.vertices)) == 0, 0, -1).astype(np.int16)
    for surface, wanted in (
        (unnamed, ["unnamed surface 3"]),
        (replace(unnamed, surface="seat"), []),
    ):
        contacts = (BodyContact("left_foot", surface, 0.9, 1),)
        touching = replace(person, contacts=contacts, contact_partner=partner)
        changed = replace(result, people=(touching,), contact_partners=(surface,))
        camera = result.intrinsics
        places = surfaces_in_photo(changed, camera.width, camera.height)
        assert list(places) == wanted
        for column, row in places.values():
            pixel = touched[0] @ np.asarray(camera.matrix).T
            np.testing.assert_allclose([column, row], pixel[:2] / pixel[2], atol=1)
