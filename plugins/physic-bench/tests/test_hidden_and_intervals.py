"""What hides a person, and what is drawn for intervals."""

from __future__ import annotations

import numpy as np
import pytest

from physic_bench.cameras import Camera
from physic_bench.contract import Frame, Surface, TruePerson, Truth
from physic_bench.intervals import figure
from physic_bench.metrics import COLUMNS
from physic_bench.scoring import occluded_share, truncated_share

from .miniatures import SIZE, K

FRAME = Frame("a", "a", Truth, Camera(K, *SIZE, np.eye(3), np.zeros(3)))
# The picture is from x = -1.917 to 1.923 m at z = 3 m; the wall before it hides x > 0.
WALL = Surface(np.array([[0, -9, 2], [9, -9, 2], [9, 9, 2], [0, 9, 2.0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def person(*x: float) -> TruePerson:
    return TruePerson(vertices=np.array([[value, 0, 3] for value in x]))


def test_outside_the_picture_is_truncated_and_not_occluded():
    somebody = person(-2.5, -1, -0.5, -0.2, 0.2, 0.5, 1, 2.5)
    assert truncated_share(FRAME, somebody) == pytest.approx(2 / 8)
    assert occluded_share(FRAME, WALL, somebody) == pytest.approx(3 / 6)
    assert occluded_share(FRAME, None, somebody) is None
    assert truncated_share(FRAME, person(-3, 3)) == 1
    assert occluded_share(FRAME, WALL, person(-3, 3)) is None
    behind = TruePerson(joints=np.array([[0, 0, -3.0], [0, 0, 3], [np.nan, 0, 3]]))
    assert truncated_share(FRAME, behind) == pytest.approx(1 / 2)


def records(sequences: int, moments: int, views: int) -> list[dict]:
    """One person; the error depends on the moment and not on the view."""
    return [
        {
            "method": "ours",
            "frame": f"{s}/{m}/{v}",
            "sequence": str(s),
            "group": f"{s}/{m}" if views > 1 else "",
            "person": "0",
            "found": True,
            "has_result": True,
            "labels": {},
            "contact": {},
            "distance_m": 3.0,
            "occlusion": 0.2,
            "truncation": 0.4 * m,
            "me_mpjpe": 10.0 * m + s,
        }
        for s in range(sequences)
        for m in range(moments)
        for v in range(views)
    ]


def test_views_of_a_moment_are_two_people_and_one_group():
    column = next(c for c in COLUMNS if c.key == "me_mpjpe")
    one, two = (figure(records(1, 3, views), column) for views in (1, 2))
    assert (one.count, one.groups, two.count, two.groups) == (3, 3, 6, 3)
    assert (two.value, two.low, two.high) == (one.value, one.low, one.high)
    assert figure(records(4, 3, 2), column).groups == 4
