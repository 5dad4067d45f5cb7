"""Print the summary of a result, at the end of ``physic run`` and by ``physic show``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from physic_core.cli.output import echo
from physic_core.io.results import read_record
from physic_core.pictures import REPORT_FILE
from physic_core.types import MARKS, marks_of_row, marks_text, summarize_checks, usable_text
from physic_core.types.records import is_usable
from physic_core.types.results import metres_text

SHOWN_NOTES = 3  # on a terminal, the most useful first


def print_summary(
    folder: Path,
    *,
    verbose: bool = False,
    notes: int | None = SHOWN_NOTES,
    seconds: float | None = None,
) -> None:
    """Print the summary of a result: its people, for how many of them each mark is usable, and
    where its page is.

    Args:
        folder: of the result.
        verbose: whether to list the time of each stage, and each check that is not ok.
        notes: largest number of notes, the most useful first; None for all.
        seconds: taken by the whole command; None for the time of the result's stages.

    Raises:
        InputError: its ``reconstruction.json`` is missing, damaged, edited, or of another schema
            version.
    """
    record = read_record(folder)
    stages = record.stages
    people = record.rows
    people_text = {0: "no person, only the scene,", 1: "1 person"}.get(
        len(people), f"{len(people)} people"
    )
    work = sum(stage.seconds for stage in stages)
    loading = sum(stage.load_seconds for stage in stages)
    time = f"{work:.1f} s, plus {loading:.1f} s to load models"
    if seconds is not None:
        time = f"{seconds:.1f} s, with all steps"
    lines = [f"{people_text} in {time}"]
    backends = [stage for stage in stages if stage.provenance is not None]
    if cached := sum(stage.cached for stage in backends):
        count = f"{cached} of {len(backends)}"
        lines.append(
            f"{count} backends did not run because the cache has their results; --no-cache runs all"
        )
    lines += [line for person in people for line in _person_lines(person)]
    lines += [
        f"no body: {one.reason}; box {', '.join(f'{edge:.0f}' for edge in one.box)}, score "
        f"{one.score:.2f}"
        for one in record.unposed
        if one.is_missing
    ]
    useful = sorted(record.notes, key=_is_informative_only)
    printed_notes = useful[:notes]
    lines += [f"note: {text}" for text in printed_notes]
    if num_hidden := len(useful) - len(printed_notes):
        lines.append(f"notes not shown: {num_hidden}; physic show {folder} --notes prints them")
    lines += [f"warning: {text}" for text in record.warnings]
    if verbose:
        lines += [f"{stage.name}: {stage.seconds:.1f} s" for stage in stages]
        lines += [
            f"{'' if check.person is None else f'person {check.person}: '}{check}"
            for check in record.checks
            if not check.ok
        ]
    marks = [marks_of_row(person) for person in people]
    usable = {name: sum(is_usable(one[name]) for one in marks) for name in MARKS}
    lines.append(usable_text(usable, len(people)))
    lines.append(f"checks: {summarize_checks(record.checks)}")
    lines.append(f"results: {folder}{'' if str(folder).endswith('/') else '/'}")
    if REPORT_FILE in record.files:
        lines.append(f"page: {folder / REPORT_FILE}")
    echo("\n".join(lines))


def _is_informative_only(note: str) -> bool:
    """Return whether a note names no option of the command, and asks nothing."""
    return "--" not in note and not note.endswith("?")


def _person_lines(person: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a person: marks and distance, then what there is of contact, parts that
    the photo does not show, uncertain parts, and reasons.
    """
    distance = person["distance_m"]
    sigma = person["distance_sigma_m"]
    distance_text = "no body"
    if distance is not None:
        away = metres_text(distance, None if sigma is None else sigma / distance, 1)
        distance_text = f"{away} away"
    yield f"person {person['person']}: {distance_text}, {marks_text(marks_of_row(person))}"
    contacts = "; ".join(filter(None, (person["contacts"], person["assumed"])))
    texts = {
        "contact": contacts or ("none" if distance is not None else ""),
        "not visible": _merge_sides(person["unseen"] or ""),
        "uncertain": _merge_sides(person["unsure"] or ""),
        "why": person["why"],
    }
    for name, text in texts.items():
        if text:
            yield f"  {name}: {text}"


def _merge_sides(parts: str) -> str:
    """Return a list of parts in which "both hands" stands for the left and the right one."""
    names = parts.split(", ") if parts else []
    words: dict[str, None] = {}
    for name in names:
        _, _, of = name.partition(" ")
        has_both = {f"left {of}", f"right {of}"} <= {*names}
        plural = "feet" if of == "foot" else f"{of}s"
        words[f"both {plural}" if has_both else name] = None
    return ", ".join(words)
