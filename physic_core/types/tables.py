"""Tables of results: a row of ``people.csv`` for each person, and one of ``summary.csv`` for each
photo.

A column is declared once, with its meaning and its value; rows, files, and the tables of
docs/outputs.md follow from it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from physic_core.types.contacts import PARTNER_KINDS, contacts_text, part_words
from physic_core.types.records import MARKS
from physic_core.types.results import LIMB_ENDS, pelvis_distance_m
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from physic_core.types.records import CheckResult
    from physic_core.types.results import Person, Reconstruction

_METRES_DIGITS = 3


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes:
        name: with the unit at its end, such as "distance_m".
        meaning: what it holds, for readers.
        value: of one row; None where unknown.
        is_text: whether it holds a text; otherwise a number.
    """

    name: str
    meaning: str
    value: Callable[[Any], Any]
    is_text: bool = False


@dataclass(frozen=True)
class _Row:
    """What a row of ``people.csv`` is made from: a person, their index, and the standard deviation
    of the logarithm of their distance.
    """

    index: int
    person: Person
    distance_sigma: float | None


def _of(name: str) -> Callable[[_Row], Any]:
    return lambda row: getattr(row.person, name)


def _part_names_of(name: str) -> Callable[[_Row], str]:
    return lambda row: ", ".join(map(part_words, getattr(row.person, name)))


def _rounded(value: float | None, digits: int = _METRES_DIGITS) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)


def spread_m(metres: float | None, log_sigma: float | None) -> float | None:
    """Return the standard deviation of a length, meters, from that of its logarithm; None if one is
    not known.
    """
    return None if metres is None or log_sigma is None else metres * log_sigma


def _limb_sigma(limb: str, row: _Row) -> float | None:
    return _rounded(row.person.limb_sigmas[limb])


def _angle(name: str, row: _Row) -> float | None:
    return _rounded(row.person.joint_angles[name], 1)


def _num_usable(mark: str, result: Reconstruction) -> int:
    return result.usable[mark]


def _limb_columns() -> Iterator[Column]:
    for limb in LIMB_ENDS:
        yield Column(
            f"{limb}_sigma_m",
            f"error of the end of the {part_words(limb)}, relative to the middle of the hips",
            partial(_limb_sigma, limb),
        )


def _angle_columns() -> Iterator[Column]:
    angles = ("hip_flexion", "knee_flexion", "shoulder_elevation", "elbow_flexion")
    names = (
        *("trunk_flexion", "neck_flexion"),
        *(f"{side}_{a}" for a in angles for side in SIDES),
    )
    for name in names:
        yield Column(
            f"{name}_deg",
            name.replace("_", " "),
            partial(_angle, name),
        )


_PERSON = (
    Column("person", "index into the people of the result", lambda row: row.index),
    Column(
        "usable",
        "which of pose, place, contact and size are probably right (0.7 or more)",
        lambda row: ", ".join(row.person.usable),
        is_text=True,
    ),
    *(
        Column(f"trust_{name}", f"probability that the {name} is right", _of(f"trust_{name}"))
        for name in MARKS
    ),
    Column("trust", "probability that all four are right", _of("trust")),
    Column("why", "what lowers these most, and what to do", _of("why"), is_text=True),
    Column(
        "body_source",
        "what you give as the body; empty for an estimated one",
        lambda row: row.person.body_source or None,
        is_text=True,
    ),
    Column(
        "distance_m",
        "distance of the pelvis from the camera; empty without a body",
        lambda row: _rounded(pelvis_distance_m(row.person)),
    ),
    Column(
        "distance_sigma_m",
        "its standard deviation",
        lambda row: _rounded(spread_m(pelvis_distance_m(row.person), row.distance_sigma)),
    ),
    Column(
        "stature_m",
        "standing height from soles to crown; empty without a body",
        lambda row: _rounded(row.person.stature),
    ),
    Column(
        "stature_sigma_m",
        "its standard deviation; people of unknown age may be children",
        lambda row: _rounded(spread_m(row.person.stature, row.person.stature_sigma)),
    ),
    Column(
        "posture",
        "most probable one of stand, walk, run, sit, squat, kneel, lie, jump and ride; empty for "
        "people on hands and feet",
        _of("posture"),
        is_text=True,
    ),
    Column("posture_probability", "its probability", _of("posture_probability")),
    Column(
        "child_probability",
        "probability that the person is younger than about 12 years",
        _of("child_probability"),
    ),
    Column(
        "contacts",
        "body parts that probably (0.5 or more) touch something, with what and the probability",
        lambda row: contacts_text(row.person.contacts, assumed=False),
        is_text=True,
    ),
    Column(
        "assumed",
        "the same of body parts that the photo does not show",
        lambda row: contacts_text(row.person.contacts, assumed=True),
        is_text=True,
    ),
    Column(
        "unseen",
        "limbs, hands and feet that the photo does not show: mostly a guess",
        _part_names_of("unseen"),
        is_text=True,
    ),
    Column(
        "unsure",
        "arms and legs that the photo shows, with an error of more than 0.25 m",
        _part_names_of("unsure"),
        is_text=True,
    ),
    *_limb_columns(),
    Column(
        "pelvis_height_m",
        "height of the pelvis over the floor; empty without a floor",
        lambda row: _rounded(row.person.sizes.get("pelvis_height_m")),
    ),
    Column(
        "seat_height_m",
        "height of the lowest point of the buttocks over the floor",
        lambda row: _rounded(row.person.sizes.get("seat_height_m")),
    ),
    *_angle_columns(),
)

PERSON_COLUMNS: Mapping[str, Column] = {column.name: column for column in _PERSON}
"""Columns of ``people.csv`` by name; in a file, ``id`` stands before them, the name of the photo,
and in a batch also ``path``, its absolute path.
"""


def person_rows(result: Reconstruction) -> list[dict[str, Any]]:
    """Return a row of ``people.csv`` for each person, by the names of :data:`PERSON_COLUMNS`; None
    where unknown.
    """
    rows = [
        _Row(i, person, sigma)
        for i, (person, sigma) in enumerate(zip(result.people, result.distance_sigmas, strict=True))
    ]
    return [{name: column.value(row) for name, column in PERSON_COLUMNS.items()} for row in rows]


def person_table(result: Reconstruction) -> dict[str, list[Any]]:
    """Return the columns of ``people.csv``, by name."""
    rows = person_rows(result)
    return {name: [row[name] for row in rows] for name in PERSON_COLUMNS}


def marks_of_row(row: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the marks of a person, as :attr:`Person.marks`, from a row of :func:`person_rows`."""
    return {name: row[f"trust_{name}"] for name in MARKS}


def _distance_sigmas_of_people(result: Reconstruction) -> list[float]:
    distances = map(pelvis_distance_m, result.people)
    return [distance for distance in distances if distance is not None]


def _likely_contacts(kinds: Sequence[str], result: Reconstruction) -> int | None:
    """Return the number of likely contacts with partners of some kinds; None without partners."""
    if any(person.contact_partner is None for person in result.people):
        return None
    return sum(
        contact.likely and contact.partner.kind in kinds
        for person in result.people
        for contact in person.contacts
    )


_PHOTO = (
    Column("people", "number of people", lambda result: len(result.people)),
    *(
        Column(
            f"usable_{name}",
            f"number of people whose {name} is usable",
            partial(_num_usable, name),
        )
        for name in MARKS
    ),
    Column(
        "unposed",
        "number of people without a body, or left out; not second boxes of people with one",
        lambda result: sum(one.is_another_person for one in result.unposed),
    ),
    Column(
        "bodies",
        "number of people with a finite body",
        lambda r: len(_distance_sigmas_of_people(r)),
    ),
    Column(
        "failed_checks",
        "number of failed checks",
        lambda result: sum(check.failed for check in result.checks),
    ),
    Column(
        "unknown_checks",
        "number of checks for which nothing was measured",
        lambda result: sum(not (check.ok or check.failed) for check in result.checks),
    ),
    Column("warnings", "number of warnings", lambda result: len(result.warnings)),
    Column(
        "nearest_person_m",
        "distance of the nearest pelvis from the camera",
        lambda result: min(_distance_sigmas_of_people(result), default=None),
    ),
    Column(
        "farthest_person_m",
        "distance of the farthest pelvis from the camera",
        lambda result: max(_distance_sigmas_of_people(result), default=None),
    ),
    Column(
        "distance_sigma",
        "standard deviation of the logarithm of all distances",
        lambda result: result.distance_sigma,
    ),
    Column(
        "scene_scale",
        "factor that the optimization applied to the scene",
        lambda result: result.scene.scale,
    ),
    Column(
        "scale_sigma",
        "standard deviation of the logarithm of the scale",
        lambda result: result.scene.scale_sigma,
    ),
    Column("floor_found", "1 with a floor, else 0", lambda r: int(r.scene.floor is not None)),
    Column(
        "scene_valid_share",
        "share of the pixels with a point of the scene",
        lambda result: float(result.scene.valid.mean()),
    ),
    Column(
        "contacts",
        "number of likely pairs of a body part and what it touches",
        partial(_likely_contacts, PARTNER_KINDS),
    ),
    *(
        Column(
            f"contacts_with_{kind}",
            f"the same with {kind}",
            partial(_likely_contacts, (kind,)),
        )
        for kind in PARTNER_KINDS
    ),
    Column(
        "vertices_in_contact",
        "number of vertices in contact, of all people",
        lambda result: sum(int(person.contact.sum()) for person in result.people),
    ),
    Column("focal_px", "focal length", lambda result: result.intrinsics.fy),
    Column("focal_known", "1 if it was given, else 0", lambda r: int(r.intrinsics.known)),
    Column("width_px", "width of the photo", lambda result: result.intrinsics.width),
    Column("height_px", "height of the photo", lambda result: result.intrinsics.height),
    Column(
        "seconds",
        "time of all stages without loading models",
        lambda result: sum(stage.seconds for stage in result.stages),
    ),
    Column(
        "load_seconds",
        "time to load models",
        lambda result: sum(stage.load_seconds for stage in result.stages),
    ),
)

SUMMARY_COLUMNS: Mapping[str, Column] = {column.name: column for column in _PHOTO}
"""Columns of every :meth:`Reconstruction.summary` by name; that of a result also has ``check_NAME``
for each self-check.
"""


def photo_row(result: Reconstruction) -> dict[str, Any]:
    """Return the row of a photo: :data:`SUMMARY_COLUMNS`, and ``check_NAME`` for each self-check,
    the worst value of all people; None where not measured.
    """
    by_name: dict[str, list[CheckResult]] = defaultdict(list)
    for check in result.checks:
        by_name[check.name].append(check)
    values = {name: column.value(result) for name, column in SUMMARY_COLUMNS.items()}
    return values | {f"check_{name}": _worst_value(group) for name, group in by_name.items()}


def _worst_value(checks: list[CheckResult]) -> float | None:
    """Return the worst value of one check of several people; None if nothing was measured."""
    values = [check.value for check in checks if check.value is not None]
    worst = max if checks[0].direction == "at most" else min
    return worst(values, default=None)
