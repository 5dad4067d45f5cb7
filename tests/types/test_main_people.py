from __future__ import annotations

import numpy as np
import pytest

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
