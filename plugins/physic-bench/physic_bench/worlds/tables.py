"""Tables of ``physic bench accuracy``, as aligned text or Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from physic_bench.worlds.contact_partners import BINS
from physic_bench.worlds.paper_results import PAPER_RESULTS
from physic_bench.worlds.summary import row_difference
from physic_core.metrics import aligned_table, markdown_table

if TYPE_CHECKING:
    from physic_bench.worlds.summary import RowStatistics
    from physic_core.metrics import ValueWithInterval


@dataclass(frozen=True)
class TableColumn:
    """One column of a table.

    Attributes:
        title: column header.
        figure: name of the statistic.
        digits: number of decimals.
        interval: whether the confidence interval is printed.
    """

    title: str
    figure: str
    digits: int = 0
    interval: bool = True


@dataclass(frozen=True)
class Table:
    """Title, header, rows and notes of a table, as text."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


_PAPER_COLUMNS = (
    TableColumn("PA-MPJPE mm", "pa_mpjpe_mm", 1),
    TableColumn("MPJPE mm", "mpjpe_mm"),
    TableColumn("MPVPE mm", "mpvpe_mm"),
    TableColumn("contact P", "precision", 3),
    TableColumn("R", "recall", 3),
    TableColumn("F1", "f1_of_means", 3),
)
_CONTACT_COLUMNS = (
    TableColumn("F1 of mean P, R", "f1_of_means", 3),
    TableColumn("F1 pooled", "f1_pooled", 3),
    TableColumn("F1 mean of images", "f1_mean_image", 3),
    TableColumn("geodesic FP cm", "geodesic_fp_cm", 1),
    TableColumn("geodesic FN cm", "geodesic_fn_cm", 1),
    TableColumn("hidden limbs PA mm", "hidden_limbs_pa_mm", 1),
)
_PARTNER_COLUMNS = (
    TableColumn("partner right", "partner_accuracy", 3),
    TableColumn("scene F1", "scene_contact_f1", 3),
    TableColumn("people F1", "people_contact_f1", 3),
    TableColumn("self F1", "self_contact_f1", 3),
    TableColumn("item R", "item_recall", 3),
    TableColumn("support F1", "support_f1", 3),
    TableColumn("reported support F1", "reported_support_f1", 3),
    TableColumn("Brier", "brier", 4),
    TableColumn("ECE", "ece", 3),
    TableColumn("ECE of p >= .1", "ece_likely", 3),
    TableColumn("ECE of unseen limbs", "ece_unseen", 3),
)
_SCENE_COLUMNS = (
    TableColumn("penetration mm", "penetration_mm", 1),
    TableColumn("volume l", "penetration_litres", 2),
    TableColumn("floating mm", "floating_mm", 1),
    TableColumn("true penetration mm", "true_penetration_mm", 1),
    TableColumn("true floating mm", "true_floating_mm", 1),
    TableColumn("scene points mm", "scene_point_mm"),
    TableColumn("scale error %", "scene_scale_percent", 1),
    TableColumn("floor height mm", "floor_height_mm"),
    TableColumn("engine s", "seconds", 1, interval=False),
)

_Rows = Mapping[str, "RowStatistics"]


def accuracy_tables(
    rows: _Rows,
    labels: Mapping[str, str],
    truth: Mapping[str, ValueWithInterval],
    actions: Mapping[str, Mapping[str, Mapping[str, Any]]],
    blind: Sequence[str] = (),
) -> tuple[Table, ...]:
    """Build the paper's table, tables of contact and scene metrics, and a table by action.

    Args:
        rows: row key -> statistics.
        labels: row key -> printed label.
        truth: contact metrics of the ground truth itself.
        actions: result of :func:`physic_bench.worlds.summary.by_action`.
        blind: worlds in which the estimators failed, with the reason.
    """
    first = next(iter(rows.values()))
    paper = _figures_table("Ablation", rows, labels, _PAPER_COLUMNS)
    head = (*paper.head, "missed", "at start")
    counted = tuple(
        (*texts, str(f.missed), str(f.left_at_start)) for texts, f in zip(paper.rows, rows.values(), strict=True)
    )
    notes = [
        f"{first.people} people; mean ± half the 95 % interval; lower is better up to MPVPE, higher from P on",
        "missed: people without a body, in no mean but those of contact, where they score 0; at start: people whom the "
        "engine did not optimise",
    ]
    if first.false_alarms:
        notes.append(f"{first.false_alarms} bodies match no person")
    notes += [f"{text}: its people count as missed in every row" for text in blind]
    notes += [f"{labels[k]}: ended with an error in {f.errors} worlds" for k, f in rows.items() if f.errors]
    scene = _figures_table("Touch and scene", {k: f for k, f in rows.items() if k != "start"}, labels, _SCENE_COLUMNS)
    measured = tuple(_text(truth.get(c.figure), c) for c in _SCENE_COLUMNS)
    return (
        Table(paper.title, head, counted, tuple(notes)),
        _figures_table("Contact and hidden limbs", rows, labels, _CONTACT_COLUMNS),
        _partner_table(rows, labels),
        *_reliability_table(rows, labels),
        Table(
            scene.title,
            scene.head,
            (*scene.rows, ("the truth itself", *measured)),
            (
                "penetration: mean depth of the vertices inside the reconstructed scene; floating: mean distance of "
                "the truly touching vertices from it, where up to 20 mm still is touching",
                "true penetration and floating: against the true scene, after the factor about the camera that gives "
                "the reconstructed scene its true median depth",
            ),
        ),
        *_action_table(actions, labels),
        _printed_table(rows, labels),
    )


def main_row(keys: Sequence[str]) -> str | None:
    """Return the key of the main row: the trial, else the full model, else the last engine row; None without one."""
    engine = [key for key in keys if key != "start"]
    return next((key for key in ("trial", "full") if key in engine), engine[-1] if engine else None)


def trial_table(trial: RowStatistics, full: RowStatistics, label: str, worlds: str) -> Table:
    """Build the table that compares changed settings (a "trial") with the full model on the same worlds.

    Args:
        trial: statistics of the trial.
        full: statistics of the full model.
        label: description of the changed settings.
        worlds: description of the worlds.
    """
    columns = (
        *_PAPER_COLUMNS,
        _CONTACT_COLUMNS[-1],
        _SCENE_COLUMNS[0],
        _SCENE_COLUMNS[2],
        _SCENE_COLUMNS[3],
        _SCENE_COLUMNS[4],
    )
    rows = []
    for column in columns:
        change, name = row_difference(trial, full, column.figure), column.figure
        sure = change.low > 0 or change.high < 0
        rows.append(
            (
                column.title,
                _number(full.figures[name].value, column.digits),
                _number(trial.figures[name].value, column.digits),
                f"{_number(change.value, column.digits + 1, signed=True)} "
                f"[{_number(change.low, column.digits + 1, signed=True)}, "
                f"{_number(change.high, column.digits + 1, signed=True)}]",
                "yes" if sure else "no",
            )
        )
    pairs = {row[0]: f"{row[1]} -> {row[2]}" for row in rows}
    line = " | ".join((worlds, label, *(pairs[_PAPER_COLUMNS[i].title] for i in (0, 1, 5)), ""))
    return Table("Trial", ("", "full", "trial", "row_difference", "beyond chance"), tuple(rows), (f"| {line}|",))


def as_text(table: Table) -> str:
    """Format a table as aligned text."""
    body = aligned_table([table.head, *table.rows]).split("\n")
    return "\n".join([table.title, "", body[0], "-" * max(map(len, body)), *body[1:], *table.notes])


def as_markdown(table: Table) -> str:
    """Format a table as Markdown."""
    cells = markdown_table([table.head, *table.rows])
    return "\n".join([f"## {table.title}", "", cells, "", *(f"{note}  " for note in table.notes)])


def _figures_table(title: str, rows: _Rows, labels: Mapping[str, str], columns: Sequence[TableColumn]) -> Table:
    """Build a table of statistics, one row per table row."""
    body = tuple((labels[key], *(_text(f.figures[c.figure], c) for c in columns)) for key, f in rows.items())
    return Table(title, ("", *(c.title for c in columns)), body)


def _partner_table(rows: _Rows, labels: Mapping[str, str]) -> Table:
    """Build the table of contact partners, of the rows that estimate them."""
    shown = {key: row for key, row in rows.items() if key != "start"}
    table = _figures_table("What people touch", shown, labels, _PARTNER_COLUMNS)
    notes = (
        "partner right: of the vertices that touch something and are found in contact; F1 over the vertices of all "
        "people; support: over body parts in contact with the scene; reported support: over those that are reported to "
        "carry; ECE: over outer vertices, in ten bins",
    )
    return Table(table.title, table.head, table.rows, notes)


def _reliability_table(rows: _Rows, labels: Mapping[str, str]) -> list[Table]:
    """Build the table of the reliability diagram of the main row."""
    key = main_row(list(rows))
    if key is None or not rows[key].reliability.any():
        return []
    body = []
    for number, (count, likely, true) in enumerate(rows[key].reliability):
        shares = (likely / count, true / count) if count else (math.nan, math.nan)
        body.append(
            (f"{number / BINS:.1f} to {(number + 1) / BINS:.1f}", f"{count:.0f}", *(_number(x, 3) for x in shares))
        )
    head = ("probability of contact", "vertices", "mean probability", "in contact")
    return [Table(f"Calibration: {labels[key]}", head, tuple(body), ("outer vertices of all people with a body",))]


def _printed_table(rows: _Rows, labels: Mapping[str, str]) -> Table:
    """Build the table of the numbers printed in the paper."""
    body = []
    for key in rows:
        if printed := PAPER_RESULTS.get(key):
            numbers = ((getattr(printed, c.figure), c.digits) for c in _PAPER_COLUMNS)
            body.append((labels[key], *("–" if n is None else _number(n, digits) for n, digits in numbers)))
    return Table("The paper's own, on PROX", ("", *(c.title for c in _PAPER_COLUMNS)), tuple(body))


def _action_table(actions: Mapping[str, Mapping[str, Mapping[str, Any]]], labels: Mapping[str, str]) -> list[Table]:
    """Build the table by action: start row and main row."""
    keys = list(next(iter(actions.values()), {}))
    chosen = main_row(keys)
    if chosen is None:
        return []
    start = "start" in keys
    pairs = (("PA mm", "pa_mpjpe_mm", 1), ("hidden PA mm", "hidden_limbs_pa_mm", 1))
    singles = (
        ("MPJPE mm", "mpjpe_mm", 0),
        ("F1", "f1_of_means", 3),
        ("penetration mm", "penetration_mm", 1),
        ("floating mm", "floating_mm", 1),
    )
    head = ["action", "people", "missed", "with hidden limbs"]
    for title, _, _ in pairs:
        head += [f"start {title}", title] if start else [title]
    head += ["hidden change mm"] if start else []
    head += [title for title, _, _ in singles]
    body = []
    for action, found in sorted(actions.items()):
        row = found[chosen]
        line = [action, str(row["people"]), str(row["missed"]), str(row["hidden_limbs_people"])]
        for _, name, digits in pairs:
            line += [_number(found[key][name], digits) for key in (["start"] if start else []) + [chosen]]
        if start:
            change, half = row["hidden_limbs_change_mm"], row["hidden_limbs_change_half_mm"]
            line.append(_number(change, 1, signed=True) + (f" ±{half:.1f}" if math.isfinite(half) else ""))
        body.append((*line, *(_number(row[name], digits) for _, name, digits in singles)))
    notes = ("hidden change: mean over those people ± half the 95 % interval; none for a single one",) if start else ()
    return [Table(f"By action: {labels[chosen]}", tuple(head), tuple(body), notes)]


def _text(figure: ValueWithInterval | None, column: TableColumn) -> str:
    """Format a statistic."""
    if figure is None or not math.isfinite(figure.value):
        return "–"
    value = _number(figure.value, column.digits)
    return f"{value} ±{_number((figure.high - figure.low) / 2, column.digits)}" if column.interval else value


def _number(value: float, digits: int, signed: bool = False) -> str:
    """Format a number; a dash if it is not finite."""
    if not math.isfinite(value):
        return "–"
    return f"{value:+.{digits}f}" if signed else f"{value:.{digits}f}"
