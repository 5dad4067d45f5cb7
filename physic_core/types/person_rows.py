"""A row for each person of a result: how far to trust the body, where it is, how tall it is, and what it touches.

The main people count for the grade of a photo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from physic_core.types.contacts import part_words
from physic_core.types.records import Grade

if TYPE_CHECKING:
    from physic_core.types.arrays import FloatArray
    from physic_core.types.records import CheckResult
    from physic_core.types.results import Person, Reconstruction

PERSON_COLUMNS: Mapping[str, str] = {
    "photo": "name of the photo; in a batch its id",
    "person": "index into the people of the result",
    "main": "True if the grade of the photo counts this person",
    "grade": "of the person: good, doubtful or bad",
    "why": "the checks that failed, with their values; if none, and the grade is not good, those not measured",
    "distance_m": "of the pelvis from the camera; empty without a body",
    "distance_sigma_m": "standard deviation of the distance; empty where it is not known",
    "stature_m": "standing height of the body; empty without a body",
    "stature_sigma_m": "standard deviation of the stature, in which people of unknown age may be children",
    "contacts": "body parts that are likely (one half or more) to touch something, each with what it touches",
    "assumed": "likely contacts of body parts that no pixel shows, not among the others",
}
"""Columns of ``people.csv``."""


def person_rows(result: Reconstruction) -> list[dict[str, Any]]:
    """Return a row for each person: the columns of :data:`PERSON_COLUMNS` but the photo; None where unknown."""
    main = main_people([person.box for person in result.people])
    rows = []
    for index, (person, sigma) in enumerate(zip(result.people, result.distance_sigmas, strict=True)):
        distance = pelvis_distance_m(person)
        rows.append(
            {
                "person": index,
                "main": index in main,
                "grade": str(person.grade or ""),
                "why": _why(person, [check for check in result.checks if check.person == index]),
                "distance_m": _millimetres(distance),
                "distance_sigma_m": _millimetres(spread_m(distance, sigma)),
                "stature_m": _millimetres(person.stature),
                "stature_sigma_m": _millimetres(spread_m(person.stature, person.stature_sigma)),
                "contacts": _contacts(person, assumed=False),
                "assumed": _contacts(person, assumed=True),
            }
        )
    return rows


def _contacts(person: Person, *, assumed: bool) -> str:
    chosen = (one for one in person.contacts if one.likely and one.assumed == assumed)
    return "; ".join(f"{part_words(one.part)}: {one.partner.title}" for one in chosen)


def _why(person: Person, checks: Sequence[CheckResult]) -> str:
    failed = [f"{check.title}: {check.value_text}" for check in checks if check.failed]
    if failed or person.grade is Grade.GOOD:
        return "; ".join(failed)
    unknown = "; ".join(check.title for check in checks if not check.ok)
    return f"not measured: {unknown}" if unknown else ""


def pelvis_distance_m(person: Person) -> float | None:
    """Return the distance of a person's pelvis from the camera, metres; None without a body."""
    return distance_m(person.joints[0].tolist() if len(person.joints) else None)


def distance_m(point: Sequence[float] | None) -> float | None:
    """Return the distance of a point x, y, z from the camera, metres; None for None and for a point that is not
    finite."""
    return math.hypot(*point) if point is not None and all(map(math.isfinite, point)) else None


def spread_m(metres: float | None, log_sigma: float | None) -> float | None:
    """Return the standard deviation of a length, metres, from that of its logarithm; None if one is not known."""
    return None if metres is None or log_sigma is None else metres * log_sigma


def _millimetres(metres: float | None) -> float | None:
    return None if metres is None else round(metres, 3)


_MAIN_SHARE = 0.5


def main_people(boxes: Sequence[FloatArray] | FloatArray) -> tuple[int, ...]:
    """Return the indices of the main people: those at least half as large in the photo as the largest one.

    The size is the longer side of the box: people who lie are as large as people who stand.

    Args:
        boxes: (4,) each, x0 y0 x1 y1, px.
    """
    sizes = [max(float(x1 - x0), float(y1 - y0)) for x0, y0, x1, y1 in boxes]
    return tuple(i for i, size in enumerate(sizes) if size >= _MAIN_SHARE * max(sizes))


def metres_text(metres: float, log_sigma: float | None, digits: int = 2) -> str:
    """Return a length with its standard deviation: "4.20 ± 0.71 m"; without one: "4.20 m".

    Args:
        metres: the length.
        log_sigma: standard deviation of its logarithm, or None.
        digits: after the point.
    """
    spread = "" if log_sigma is None else f" ± {log_sigma * abs(metres):.{digits}f}"
    return f"{round(metres, digits) + 0.0:.{digits}f}{spread} m"  # no "-0.00"
