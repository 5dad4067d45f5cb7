"""The tables that ``physic bench accuracy`` prints, as aligned text or Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from physic_testing.bench.paper import PAPER
from physic_testing.bench.summary import difference

if TYPE_CHECKING:
    from physic_testing.bench.summary import Figure, Figures

__all__ = ["Column", "Table", "accuracy_tables", "as_markdown", "as_text", "shown_row", "trial_lines"]


@dataclass(frozen=True)
class Column:
    """One figure.

    Attributes:
        title: head of the column.
        figure: its name.
        digits: behind the point.
        interval: print it.
    """

    title: str
    figure: str
    digits: int = 0
    interval: bool = True


@dataclass(frozen=True)
class Table:
    """Texts: a title, a head, rows under it, and notes."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


_PAPER = (
    Column("PA-MPJPE mm", "pa_mpjpe_mm", 1),
    Column("MPJPE mm", "mpjpe_mm"),
    Column("MPVPE mm", "mpvpe_mm"),
    Column("contact P", "precision", 3),
    Column("R", "recall", 3),
    Column("F1", "f1_of_means", 3),
)
_CONTACT = (
    Column("F1 of mean P, R", "f1_of_means", 3),
    Column("F1 pooled", "f1_pooled", 3),
    Column("F1 mean of images", "f1_mean_image", 3),
    Column("geodesic FP cm", "geodesic_fp_cm", 1),
    Column("geodesic FN cm", "geodesic_fn_cm", 1),
    Column("hidden limbs PA mm", "hidden_limbs_pa_mm", 1),
)
_SCENE = (
    Column("penetration mm", "penetration_mm", 1),
    Column("volume l", "penetration_litres", 2),
    Column("floating mm", "floating_mm", 1),
    Column("scene points mm", "scene_point_mm"),
    Column("scale error %", "scene_scale_percent", 1),
    Column("floor height mm", "floor_height_mm"),
    Column("engine s", "seconds", 1, interval=False),
)

_Rows = Mapping[str, "Figures"]


def accuracy_tables(
    rows: _Rows,
    labels: Mapping[str, str],
    truth: Mapping[str, Figure],
    actions: Mapping[str, Mapping[str, Mapping[str, Any]]],
    blind: Sequence[str] = (),
) -> tuple[Table, ...]:
    """The paper's table, two of what it does not print, and one by action.

    Args:
        rows: key -> figures.
        labels: key -> as printed.
        truth: what the measures of touch say of the truth itself.
        actions: of :func:`physic_testing.bench.summary.by_action`.
        blind: worlds of which the estimators said nothing, and why.
    """
    first = next(iter(rows.values()))
    paper = _figures_table("Ablation", rows, labels, _PAPER)
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
        notes.append(f"{first.false_alarms} bodies are nobody")
    notes += [f"{text}: its people count as missed in every row" for text in blind]
    notes += [f"{labels[k]}: ended with an error in {f.errors} worlds" for k, f in rows.items() if f.errors]
    scene = _figures_table("Touch and scene", {k: f for k, f in rows.items() if k != "start"}, labels, _SCENE)
    measured = tuple(_text(truth.get(c.figure), c) for c in _SCENE)
    return (
        Table(paper.title, head, counted, tuple(notes)),
        _figures_table("Contact and hidden limbs", rows, labels, _CONTACT),
        Table(
            scene.title,
            scene.head,
            (*scene.rows, ("the truth itself", *measured)),
            (
                "penetration: mean depth of the vertices inside the reconstructed scene; floating: mean distance of "
                "the truly touching vertices from it, where up to 20 mm still is touching",
            ),
        ),
        *_action_table(actions, labels),
        _printed_table(rows, labels),
    )


def shown_row(keys: Sequence[str]) -> str | None:
    """The row that matters most: the trial, the full model, or the last there is; None where only the start is."""
    engine = [key for key in keys if key != "start"]
    return next((key for key in ("trial", "full") if key in engine), engine[-1] if engine else None)


def trial_lines(trial: Figures, full: Figures, label: str, worlds: str) -> Table:
    """The full row against the trial: what changed, and its interval over the same worlds.

    Args:
        trial: the full model, changed.
        full: the full model.
        label: what was changed, in words.
        worlds: which they were, in words.
    """
    columns = (*_PAPER, _CONTACT[-1], _SCENE[0], _SCENE[2], _SCENE[3], _SCENE[4])
    rows = []
    for column in columns:
        change, name = difference(trial, full, column.figure), column.figure
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
    line = " | ".join((worlds, label, *(pairs[_PAPER[i].title] for i in (0, 1, 5)), ""))
    return Table("Trial", ("", "full", "trial", "difference", "beyond chance"), tuple(rows), (f"| {line}|",))


def as_text(table: Table) -> str:
    """Aligned columns."""
    lines = [table.head, *table.rows]
    widths = [max(len(line[i]) for line in lines) for i in range(len(table.head))]
    body = [
        "  ".join(
            t.ljust(w) if i == 0 else t.rjust(w) for i, (t, w) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([table.title, "", body[0], "-" * max(map(len, body)), *body[1:], *table.notes])


def as_markdown(table: Table) -> str:
    """A Markdown table."""
    bars = ["| " + " | ".join(line) + " |" for line in (table.head, *table.rows)]
    rule = "|---|" + "---:|" * (len(table.head) - 1)
    return "\n".join([f"## {table.title}", "", bars[0], rule, *bars[1:], "", *(f"{note}  " for note in table.notes)])


def _figures_table(title: str, rows: _Rows, labels: Mapping[str, str], columns: Sequence[Column]) -> Table:
    body = tuple((labels[key], *(_text(f.figures[c.figure], c) for c in columns)) for key, f in rows.items())
    return Table(title, ("", *(c.title for c in columns)), body)


def _printed_table(rows: _Rows, labels: Mapping[str, str]) -> Table:
    body = []
    for key in rows:
        if printed := PAPER.get(key):
            numbers = ((getattr(printed, c.figure), c.digits) for c in _PAPER)
            body.append((labels[key], *("–" if n is None else _number(n, digits) for n, digits in numbers)))
    return Table("The paper's own, on PROX", ("", *(c.title for c in _PAPER)), tuple(body))


def _action_table(actions: Mapping[str, Mapping[str, Mapping[str, Any]]], labels: Mapping[str, str]) -> list[Table]:
    """The start beside the row that matters most."""
    keys = list(next(iter(actions.values()), {}))
    chosen = shown_row(keys)
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


def _text(figure: Figure | None, column: Column) -> str:
    if figure is None or not math.isfinite(figure.value):
        return "–"
    value = _number(figure.value, column.digits)
    return f"{value} ±{_number((figure.high - figure.low) / 2, column.digits)}" if column.interval else value


def _number(value: float, digits: int, signed: bool = False) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{value:+.{digits}f}" if signed else f"{value:.{digits}f}"
