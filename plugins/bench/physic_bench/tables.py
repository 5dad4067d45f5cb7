"""The one table of results: a row for each figure, a column for each method, and the differences
from one of them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from physic_bench.figures import difference, figure
from physic_core.files import MARK, atomic_write, check_own, check_writable, to_json
from physic_testing.metrics import aligned_table, markdown_table

if TYPE_CHECKING:
    from pathlib import Path

    from physic_bench.figures import Column
    from physic_testing.metrics import ValueWithInterval

    Record = Mapping[str, Any]
    Figures = Mapping[str, Mapping[str, ValueWithInterval]]

FILES = ("table.txt", "table.md", "results.json")


def check_results(folder: Path) -> None:
    """Raise OutputError if the results would replace a file of the user."""
    check_own(*(folder / name for name in FILES))


def write_results(
    records: Mapping[str, Sequence[Record]],
    columns: Sequence[Column],
    folder: Path,
    header: str,
    notes: Sequence[str],
    document: Mapping[str, Any],
) -> list[Path]:
    """Write table.txt, table.md and results.json, completely or not at all, and return their paths.

    Args:
        records: of each method; the others are compared with the first.
        columns: of the tables; those for which no method has a value are left out.
        folder: for the files.
        header: a line over the tables.
        notes: sentences below the tables.
        document: of the JSON file, beside the figures.

    Raises:
        OutputError: the folder cannot be written, or has files of the user with these names.
    """
    check_results(check_writable(folder))
    first, *others = records
    figures = {name: {c.key: figure(rows, c) for c in columns} for name, rows in records.items()}
    known_columns = [
        c for c in columns if any(by_column[c.key].count for by_column in figures.values())
    ]
    differences = {
        name: {c.key: difference(records[first], records[name], c) for c in known_columns}
        for name in others
    }
    parts = [
        _table_rows(figures, known_columns, signed=False),
        _table_rows(differences, known_columns, signed=True),
    ]
    lines = [*notes, MARK]
    bullets = [f"- {' '.join(line.splitlines())}" for line in lines]
    results = {
        "note": MARK,
        "header": header,
        "notes": list(notes),
        **document,
        "columns": [
            {key: getattr(c, key) for key in ("key", "label", "definition", "better")}
            for c in known_columns
        ],
        "figures": _figures_as_json(figures),
        "differences": _figures_as_json(differences),
    }
    texts = (
        "\n".join([header, "", _tables_text(aligned_table, parts, first), "", *lines, ""]),
        "\n".join([header, "", _tables_text(markdown_table, parts, first), "", *bullets, ""]),
        json.dumps(to_json(results, digits=9), indent=1) + "\n",
    )
    with atomic_write(folder) as temporary:
        for name, content in zip(FILES, texts, strict=True):
            temporary(name).write_text(content, encoding="utf-8")
    return [folder / name for name in FILES]


def _tables_text(
    draw: Callable[[list[list[str]]], str], tables: Sequence[list[list[str]]], first: str
) -> str:
    """Return the figures, and below them the differences from the first method if there are any."""
    figures, differences = map(draw, tables)
    if len(tables[1]) == 1:
        return figures
    title = f"Difference from {first}, on people whom both measure"
    return "\n\n".join([figures, title, differences])


def _table_rows(shown: Figures, columns: Sequence[Column], *, signed: bool) -> list[list[str]]:
    """Return the table of figures of methods, without rows that have none."""
    rows = [["", *shown, "of"]]
    for column in columns:
        in_column = [figures[column.key] for figures in shown.values()]
        cells = [column.text(f, signed=signed) for f in in_column]
        if set(cells) - {"-"}:
            rows.append([column.label, *cells, str(max(f.count for f in in_column))])
    return rows


def _figures_as_json(figures: Figures) -> dict[str, Any]:
    return {
        name: {key: asdict(f) for key, f in by_column.items()}
        for name, by_column in figures.items()
    }
