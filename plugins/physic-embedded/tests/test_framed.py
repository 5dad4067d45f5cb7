"""People in frames and mirrors and on tables are named; those who stand before one are not."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import SKELETONS, SURFACE_NAMES, Keypoints, People, SurfaceLabels
from physic_embedded.segmentation.framed import figurine_note, framed_note

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


@pytest.mark.parametrize(
    ("ankle", "under", "named"),
    [(0.9, "table", True), (0.1, "table", False), (0.9, "floor", False)],
)
def test_a_person_whose_feet_stand_on_a_table_may_be_a_figurine(ankle, under, named):
    labels = np.full(PEOPLE.shape[1:], SURFACE_NAMES.index("wall"), np.uint8)
    labels[65:] = SURFACE_NAMES.index(under)
    names = SKELETONS["coco17"].names
    confidence = np.zeros((2, 17))
    confidence[0, names.index("left_ankle")] = ankle
    people = People(
        masks=PEOPLE,
        boxes=np.array([[20, 30, 40, 70], [120, 0, 150, 90]], float),
        scores=np.ones(2),
        keypoints=Keypoints(np.zeros((2, 17, 2)), confidence, "coco17"),
        surfaces=SurfaceLabels(labels),
    )
    notes = figurine_note(people)
    assert ["(20, 30, 40, 70)" in note and "--ignore" in note for note in notes] == [True] * named
