"""Write an evaluation: tables, every record and previews; completely or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.metrics import CONTACT_FIGURES
from physic_bench.score_journal import SCORES
from physic_bench.tables import Tables, compute_tables, latex_table, markdown_tables, text_table
from physic_bench.wording import counted

if TYPE_CHECKING:
    from physic_bench.evaluation import Evaluation

_TABLES = ("table.txt", "table.md", "table.tex", "results.json")

NAMED = 5
"""Frames without a result that the notes name."""


def check_output(out: Path) -> None:
    """Check that an evaluation would replace no file of the user.

    Raises:
        OutputError: the folder has a file with a name of the evaluation that PhySIC has not written.
    """
    from physic_core.batch.journal import check_journal
    from physic_core.files.atomic import check_own

    check_own(*(out / name for name in _TABLES))
    check_own(*out.glob("worst/*/[0-9][0-9]-*.jpg"))
    check_journal(out / SCORES / "journal.jsonl")


def write_evaluation(evaluation: Evaluation, out: Path, settings: Mapping[str, Any]) -> list[Path]:
    """Write table.txt, table.md, table.tex, results.json and the previews of the worst frames, and return their paths.

    Raises:
        OutputError: the folder cannot be written, or has files of the user with these names.
    """
    from physic_bench.previews import write_previews
    from physic_core.files.atomic import MARK, atomic_write, check_writable

    check_output(out)
    names = [method.name for method in evaluation.methods]
    contact_truths = list(dict.fromkeys(name for record in evaluation.records for name in record["contact"]))
    tables = compute_tables(evaluation.records, names, contact_truths)
    notes = summary_of(evaluation) + _unequal_counts(tables)
    lines = [*notes, MARK]
    header = settings["header"]
    texts = {
        "table.txt": f"{header}\n\n{text_table(tables)}\n" + "\n".join(lines) + "\n",
        "table.md": f"{header}\n\n{markdown_tables(tables)}\n" + "\n".join(f"- {line}" for line in lines) + "\n",
        "table.tex": _comment(header) + latex_table(tables) + "".join(map(_comment, lines)),
        "results.json": _document(evaluation, tables, {"note": MARK, **settings}, notes),
    }
    check_writable(out)
    with atomic_write(out) as temporary:
        for name, text in texts.items():
            temporary(name).write_text(text, encoding="utf-8")
    return [*(out / name for name in texts), *write_previews(evaluation, out / "worst")]


def _comment(text: str) -> str:
    """Return a comment of LaTeX in one line: reasons may have several."""
    return f"% {' '.join(text.splitlines())}\n"


def summary_of(evaluation: Evaluation) -> list[str]:
    """Return the sentences that a reader of the table needs."""
    notes = [*evaluation.notes]
    notes += [f"{name}: {check.sentence()}" for name, check in evaluation.checks.items()]
    for method in evaluation.methods:
        own = [record for record in evaluation.records if record["method"] == method.name]
        joints = sorted({f"{r['joints']} ({r['joint_source']})" for r in own if "joints" in r})
        if joints:
            notes.append(f"{method.name}: joints compared: {', '.join(joints)}")
        for key, what in (("vertices_carried", "the true mesh"), ("contact_carried", "predicted contact")):
            for way in sorted({str(r[key]) for r in own if key in r}):
                notes.append(f"{method.name}: approximation: {what} carried from {way} over the T-poses")
        for reason in sorted({text for r in own for text in r.get("unmeasured", ())}):
            notes.append(f"{method.name}: not measured: {reason}")
        notes += _missing_results(method.name, own)
        lost = [r for r in own if not r["found"]]
        if lost:
            share = f"{len(lost)} of {counted(len(own), 'person', 'people')}"
            notes.append(f"{method.name}: {share} without a body; contact counts them as missed")
    if evaluation.left_out:
        notes.append(f"{counted(len(evaluation.left_out), 'frame')} skipped; results.json has the reasons")
    return notes


def _missing_results(name: str, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a sentence that counts and names the frames without a result, by reason."""
    frames = len({r["frame"] for r in records})
    lost: dict[str, list[str]] = {}
    for record in records:
        own = lost.setdefault(record["reason"], [])
        if not record["has_result"] and record["frame"] not in own:
            own.append(record["frame"])
    count = sum(map(len, lost.values()))
    if not count:
        return []
    named = [f"{frame} ({reason})" for reason, own in lost.items() for frame in own]
    more = f", and {len(named) - NAMED} more in results.json" if len(named) > NAMED else ""
    return [f"{name}: {count} of {counted(frames, 'frame')} without a result: {', '.join(named[:NAMED])}{more}"]


def _unequal_counts(tables: Tables) -> list[str]:
    """Return a warning for the first column whose figures are over different numbers of people."""
    for column in tables.columns:
        own = {name: tables.figures[name][column.key].count for name in tables.methods}
        counts = {name: count for name, count in own.items() if count}
        if len(set(counts.values())) > 1:
            words = ", ".join(f"{count} of {name}" for name, count in counts.items())
            return [
                f"not over the same people: {column.label} is over {words}; compare these methods by the differences"
            ]
    return []


def _document(evaluation: Evaluation, tables: Tables, settings: Mapping[str, Any], notes: list[str]) -> str:
    methods = [
        {
            "name": method.name,
            "reader": method.reader.name,
            "folder": str(method.reader.folder),
            "frame": method.frame,
            "overlap": dict(evaluation.checks[method.name].overlap),
        }
        for method in evaluation.methods
    ]
    document = {
        **settings,
        "methods": methods,
        "notes": notes,
        "left_out": dict(evaluation.left_out),
        "columns": [
            {"key": c.key, "label": c.label, "definition": c.definition, "better": c.better} for c in tables.columns
        ],
        "figures": {name: {key: asdict(f) for key, f in own.items()} for name, own in tables.figures.items()},
        "differences": {name: {key: asdict(f) for key, f in own.items()} for name, own in tables.differences.items()},
        "averages_of_f1": list(CONTACT_FIGURES[2:]),
        "records": list(evaluation.records),
    }
    return json.dumps(_without_nan(document), indent=1, allow_nan=False)


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: what is unknown is null."""
    if isinstance(value, Mapping):
        return {str(key): _without_nan(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
