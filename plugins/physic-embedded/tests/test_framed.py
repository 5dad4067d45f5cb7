"""People in frames and mirrors are named; those who stand before one are not."""

from __future__ import annotations

import numpy as np
import pytest

from physic_embedded.segmentation.framed import framed_note

PEOPLE = np.zeros((2, 100, 200), bool)
PEOPLE[0, 30:70, 20:40] = True
PEOPLE[1, 10:90, 120:150] = True


@pytest.mark.parametrize(
    ("frame", "named"),
    [((20, 80, 10, 50), True), ((20, 50, 10, 32), False), ((0, 100, 90, 130), False)],
)
def test_a_person_around_whom_a_frame_is_may_be_a_picture(frame, named):
    top, bottom, left, right = frame
    framed = np.zeros(PEOPLE.shape[1:], bool)
    framed[top:bottom, left:right] = True
    notes = framed_note(PEOPLE, framed)
    assert ["(20, 30, 40, 70)" in note and "--ignore" in note for note in notes] == [True] * named
