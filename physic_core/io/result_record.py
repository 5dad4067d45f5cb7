"""What ``reconstruction.json`` alone tells of a result: its people in numbers, checks, times and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from physic_core.files.plain import join
from physic_core.io.results import damaged, read_document
from physic_core.types import BodyContact, CheckResult, Grade, Intrinsics, StageRecord, Support, UnposedPerson


@dataclass(frozen=True)
class PersonRecord:
    """One person of a result.

    Attributes:
        index: into the people of the result.
        pelvis: x, y, z in the camera frame, metres; NaN or None without a body.
        distance_sigma: standard deviation of the logarithm of the distance from the camera; None if it is not known.
        contact_count: number of vertices in contact.
        vertex_count: of all vertices.
        states_partners: whether the result states what is touched.

    The others are those of :class:`physic_core.types.Person`.
    """

    index: int
    pelvis: tuple[float, float, float] | None
    distance_sigma: float | None
    contact_count: int
    vertex_count: int
    states_partners: bool
    grade: Grade | None
    stature: float | None
    stature_sigma: float | None
    contacts: tuple[BodyContact, ...]
    support: Support | None
    failed_checks: tuple[str, ...]
    unknown_checks: tuple[str, ...]


@dataclass(frozen=True)
class ResultRecord:
    """A result without arrays.

    Attributes:
        files: name -> SHA-256 of each file but the document.

    The others are those of :class:`physic_core.types.Reconstruction`.
    """

    files: Mapping[str, str]
    grade: Grade | None
    people: tuple[PersonRecord, ...]
    unposed: tuple[UnposedPerson, ...]
    intrinsics: Intrinsics
    checks: tuple[CheckResult, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    stages: tuple[StageRecord, ...]


def read_record(folder: Path) -> ResultRecord:
    """Read the document of a result.

    Raises:
        InputError: it is missing, damaged, edited, or of another version.
    """
    document = read_document(folder)
    try:
        record: ResultRecord = join(ResultRecord, document, {})
    except Exception as error:  # whatever a dataclass raises for values of others
        raise damaged(folder, error) from error
    return record
