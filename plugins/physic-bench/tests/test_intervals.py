"""What is drawn for intervals."""

from __future__ import annotations

from physic_bench.intervals import figure
from physic_bench.metrics import COLUMNS


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
