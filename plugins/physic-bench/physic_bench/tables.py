"""The tables: text, Markdown and LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from physic_bench.intervals import difference, figure
from physic_bench.metrics import columns_for
from physic_core.metrics import ValueWithInterval, aligned_table, markdown_table

if TYPE_CHECKING:
    from physic_bench.metrics import Column

    Record = Mapping[str, Any]

PAPER_COLUMNS = ("pa_mpjpe", "me_mpjpe", "me_pve")
"""Of the LaTeX table, as in the paper's Table 2; precision, recall and F1 of the first contact truth follow."""


@dataclass(frozen=True, eq=False)
class Tables:
    """All figures of an evaluation.

    Attributes:
        methods: names, in order.
        columns: those for which some method has a value.
        figures: method -> column key -> figure.
        differences: method -> column key -> its figure minus the first method's; without the first.
        contact: name of the first contact truth, or "".
        common: method -> number of frames of which it and the first method have results, and of all frames.
    """

    methods: tuple[str, ...]
    columns: tuple[Column, ...]
    figures: Mapping[str, Mapping[str, ValueWithInterval]]
    differences: Mapping[str, Mapping[str, ValueWithInterval]]
    contact: str
    common: Mapping[str, tuple[int, int]]


def compute_tables(records: Sequence[Record], methods: Sequence[str], rules: Sequence[str]) -> Tables:
    """Compute all figures.

    Args:
        records: of all methods.
        methods: names, in order.
        rules: contact truths in the tables, the main one first.
    """
    own = {name: [r for r in records if r["method"] == name] for name in methods}
    columns = columns_for(rules)
    figures = {name: {c.key: figure(own[name], c) for c in columns} for name in methods}
    kept = tuple(c for c in columns if any(figures[name][c.key].count for name in methods))
    with_result = {name: {r["frame"] for r in own[name] if r["has_result"]} for name in methods}
    apart, common = {}, {}
    for name in methods[1:]:
        both = with_result[methods[0]] & with_result[name]
        first, second = ([r for r in own[k] if r["frame"] in both] for k in (methods[0], name))
        apart[name] = {c.key: difference(first, second, c) for c in kept}
        common[name] = (len(both), len({r["frame"] for r in own[name]}))
    return Tables(tuple(methods), kept, figures, apart, rules[0] if rules else "", common)


def text_table(tables: Tables) -> str:
    """Return the figures with intervals for a terminal, then the differences."""
    return _with_differences(tables, aligned_table)


def markdown_tables(tables: Tables) -> str:
    """Return the same as Markdown."""
    return _with_differences(tables, markdown_table)


def _with_differences(tables: Tables, draw: Callable[[list[list[str]]], str]) -> str:
    """Return the figures and, if there are several methods, their differences from the first."""
    parts = [draw(_figure_rows(tables))]
    if tables.differences:
        parts.append(f"Difference from {tables.methods[0]}, on people whom both measure, in frames that both have")
        parts.append(draw(_difference_rows(tables)))
    return "\n\n".join(parts) + "\n"


def latex_table(tables: Tables) -> str:
    """Return methods by the columns of the paper's table, as a ``tabular`` for the package booktabs; best is bold."""
    wanted = [*PAPER_COLUMNS, *(f"{name}@{tables.contact}" for name in ("precision", "recall", "f1_of_means"))]
    columns = [c for key in wanted for c in tables.columns if c.key == key]
    arrow = {"low": r" $\downarrow$", "high": r" $\uparrow$", "": ""}
    head = " & ".join(["Method", *(_escaped(c.label) + arrow[c.better] for c in columns)])
    lines = [rf"\begin{{tabular}}{{l{'r' * len(columns)}}}", r"\toprule", rf"{head} \\", r"\midrule"]
    best = {c.key: _best(tables, c) for c in columns}
    for name in tables.methods:
        cells = []
        for c in columns:
            text = c.text(tables.figures[name][c.key].value)
            bold = text != "-" and text == best[c.key] and len(tables.methods) > 1
            cells.append(rf"\textbf{{{text}}}" if bold else "--" if text == "-" else text)
        lines.append(rf"{' & '.join([_escaped(name), *cells])} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _best(tables: Tables, column: Column) -> str:
    values = [tables.figures[name][column.key].value for name in tables.methods]
    known = [value for value in values if value == value]
    if not known or not column.better:
        return ""
    return column.text(min(known) if column.better == "low" else max(known))


def _figure_rows(tables: Tables) -> list[list[str]]:
    rows = [["", *tables.methods, "people"]]
    for column in tables.columns:
        own = [tables.figures[name][column.key] for name in tables.methods]
        rows.append([column.label, *(_with_interval(column, f) for f in own), str(max(f.count for f in own))])
    return rows


def _difference_rows(tables: Tables) -> list[list[str]]:
    names = list(tables.differences)
    rows = [["", *names, "people"]]
    rows.append(["frames in common", *("{} of {}".format(*tables.common[name]) for name in names), ""])
    for column in tables.columns:
        own = [tables.differences[name][column.key] for name in names]
        if any(f.count for f in own):
            cells = [_with_interval(column, f, signed=True) for f in own]
            rows.append([column.label, *cells, str(max(f.count for f in own))])
    return rows


def _with_interval(column: Column, found: ValueWithInterval, *, signed: bool = False) -> str:
    text = column.text(found.value)
    if signed and text != "-" and not text.startswith("-"):
        text = f"+{text}"
    if found.low != found.low:
        return text
    return f"{text} [{column.text(found.low)}, {column.text(found.high)}]"


_TEX = {letter: f"\\{letter}" for letter in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}


def _escaped(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in text)
