"""Self-checks as JSON records, and the records of schema version 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Literal

from physic_core.files.strict_json import from_json
from physic_core.types import CheckResult, CheckState, Grade

__all__ = ["check_record", "parse_checks", "parse_grade"]

_AT_LEAST = {
    *("scene_alignment", "photo_alignment", "floor", "floor_mask", "focal_known"),
    *("placed", "optimised", "visible", "legs_seen"),
}
"""Checks of schema version 1 whose value must reach the threshold; the records do not state the direction."""


def check_record(check: CheckResult) -> dict[str, Any]:
    """Return the JSON record of a check, as in schema version 2."""
    return {**asdict(check), "state": check.state.value}


def parse_checks(records: Sequence[Mapping[str, Any]], version: int) -> tuple[CheckResult, ...]:
    """Parse the ``checks`` of a document of a schema version.

    Version 1 has ``ok``, which is true if nothing was measured, in place of ``state`` and ``direction``.
    """
    return tuple(_parse(record, version) for record in records)


def parse_grade(record: Mapping[str, Any]) -> Grade | None:
    """Parse the ``grade`` of a document or of a person; None if it was written without grades."""
    grade = record.get("grade")
    return None if grade is None else Grade(grade)


def _parse(record: Mapping[str, Any], version: int) -> CheckResult:
    value, name = from_json(record["value"]), record["name"]
    direction: Literal["at most", "at least"]
    if version == 1:
        state = CheckState.FAILED if not record["ok"] else CheckState.UNKNOWN if value is None else CheckState.OK
        direction = "at least" if name in _AT_LEAST else "at most"
    else:
        state, direction = CheckState(record["state"]), record["direction"]
    return CheckResult(
        name=name,
        state=state,
        value=value,
        threshold=from_json(record["threshold"]),
        direction=direction,
        unit=record["unit"],
        message=record["message"],
        person=record["person"],
        label=record.get("label", ""),
        share_of=record.get("share_of", ""),
    )
