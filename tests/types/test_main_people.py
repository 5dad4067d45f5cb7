from __future__ import annotations

import numpy as np
import pytest

from physic_core.pipeline.checks import CHECKS, photo_trust
from physic_core.types.results import main_people


@pytest.mark.parametrize(
    ("boxes", "main"),
    [
        ([], ()),
        ([(0, 0, 50, 100), (0, 0, 20, 50), (0, 0, 20, 49)], (0, 1)),
        ([(0, 0, 40, 100), (0, 0, 90, 30)], (0, 1)),  # the second person lies
    ],
)
def test_main_people_are_half_as_large_in_the_photo_as_the_largest(boxes, main):
    assert main_people(np.array(boxes, float).reshape(-1, 4)) == main


@pytest.mark.parametrize(("height", "trust"), [(49.0, 0.5), (50.0, 0.1)])
def test_a_photo_is_trusted_as_its_main_people(height, trust):
    """A bad person counts if large enough; else the failed check of the photo decides."""
    floor = CHECKS["floor"].compare(0.0)
    boxes = np.array([[10.0, 0.0, 30.0, 100.0], [50.0, 0.0, 70.0, height]])
    assert photo_trust([floor], [[0.9, 0.1][i] for i in main_people(boxes)]) == trust
