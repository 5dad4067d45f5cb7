"""The numbers of people in pictures."""

import numpy as np
from PIL import Image, ImageDraw

from physic_visual.numbers import draw_numbers
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


def test_a_number_leaves_a_taken_box_free():
    x, y = centers({0: (20.0, 20.0)}, [(0.0, 0.0, 60.0, 40.0)])[0]
    assert x > 60 + DISC_PX / 2 - 1 or y > 40 + DISC_PX / 2 - 1


def test_a_number_stays_in_the_picture():
    x, y = centers({0: (-50.0, 400.0)})[0]
    assert DISC_PX / 2 <= x <= SIZE[0] - DISC_PX / 2
    assert DISC_PX / 2 <= y <= SIZE[1] - DISC_PX / 2
