"""The numbers of people in pictures."""

import numpy as np
from PIL import Image, ImageDraw

from physic_visual.palette import person_color
from physic_visual.person_numbers import draw_numbers

SIZE = (200, 100)
DISC_PX = 22


def centers(places):
    page = Image.new("RGB", SIZE)
    draw_numbers(ImageDraw.Draw(page), (0, 0), places, SIZE, ())
    pixels = np.asarray(page)
    center_of = {}
    for index in places:
        rows, columns = np.nonzero((pixels == person_color(index)).all(2))
        center_of[index] = np.array([columns.mean(), rows.mean()])
    return center_of


def test_numbers_of_people_in_one_place_do_not_cover_each_other():
    places = list(centers({0: (90.0, 50.0), 1: (92.0, 51.0), 2: (90.0, 50.0)}).values())
    for i, one in enumerate(places):
        for other in places[:i]:
            assert np.abs(one - other).max() >= DISC_PX
