"""People without a body: dashed boxes in the preview, on the pixels of the box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image, ImageDraw

from physic_core.types import UnposedPerson
from physic_visual.preview import draw_unposed, unposed_boxes


def test_a_person_without_a_body_is_listed_beside_the_unposed_boxes(
    reconstruction,
):
    first, second = reconstruction.people
    nobody = replace(second, vertices=np.full_like(second.vertices, np.nan))
    one = UnposedPerson((8.0, 6.0, 40.0, 60.0), 0.7, "no pose fits the box")
    result = replace(reconstruction, people=(first, nobody), unposed=(one,))
    assert unposed_boxes(result) == [
        ((8.0, 6.0, 40.0, 60.0), "no pose fits the box"),
        (tuple(map(float, second.box)), "person 1: no body"),
    ]


def test_boxes_are_dashed_at_the_size_of_the_panel(reconstruction):
    height, width = reconstruction.image.shape[:2]
    one = UnposedPerson((20.0, 20.0, 60.0, 80.0), 0.7, "a reason that is far too long for the box")
    page = Image.new("RGB", (2 * width + 50, 2 * height + 50))
    result = replace(reconstruction, unposed=(one,))
    draw_unposed(ImageDraw.Draw(page), result, 10, 30, 2 * width, 2 * height)
    rows, columns = np.nonzero(np.asarray(page).any(-1))
    extent = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
    assert np.abs(extent - [10 + 40, 30 + 40, 10 + 120, 30 + 160]).max() <= 1
    edge = np.asarray(page)[30 + 40, 50:130].any(-1)
    assert 0.3 < edge.mean() < 0.8  # dashes and gaps
