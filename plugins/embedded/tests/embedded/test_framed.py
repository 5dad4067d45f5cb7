"""People in frames and mirrors count half; those who stand before one do not."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import People
from physic_embedded.segmentation.people_in_pictures import halve_unlikely_people

MASKS = np.zeros((2, 100, 200), bool)
MASKS[0, 30:70, 20:40] = True
MASKS[1, 10:90, 120:150] = True


PEOPLE = People(
    masks=MASKS,
    boxes=np.array([[20, 30, 40, 70], [120, 0, 150, 90]], float),
    scores=np.array([0.9, 0.8]),
)


def is_questioned(found):
    """Return whether the first person, who has the lower score then, was asked about."""
    if not found.notes:
        np.testing.assert_array_equal(found.scores, [0.9, 0.8])
        return False
    (note,) = found.notes
    assert "20,30,40,70" in note
    assert "--ignore" in note
    np.testing.assert_allclose(found.scores, [0.8, 0.45])
    np.testing.assert_array_equal(found.masks[::-1], MASKS)
    return True


@pytest.mark.parametrize(
    ("frame", "asked"),
    [((20, 80, 10, 50), True), ((20, 50, 10, 32), False), ((0, 100, 90, 130), False)],
)
def test_a_person_around_whom_a_frame_is_may_be_a_picture(frame, asked):
    top, bottom, left, right = frame
    framed = np.zeros(MASKS.shape[1:], bool)
    framed[top:bottom, left:right] = True
    assert is_questioned(halve_unlikely_people(PEOPLE, framed)) == asked
