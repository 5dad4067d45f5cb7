"""The one table of results: a row for each figure, a column for each method, and the differences
from one of them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from physic_bench.figures import difference, figure
from physic_core.files import MARK, atomic_write, check_own, check_writable, to_json
from physic_testing.metrics import ValueWithInterval, aligned_table, markdown_table

if TYPE_CHECKING:
    from pathlib import Path

    from physic_bench.figures import Column

    Record = Mapping[str, Any]

FILES = ("table.txt", "table.md", "results.json")


@dataclass(frozen=True, eq=False)
class Tables:
    """All figures of a benchmark.

    Attributes:
        columns: those for which some method has a value.
        figures: method -> column key -> figure.
        first: the method that the others are compared with.
        differences: method -> column key -> its figure minus that of ``first``.
    """

    columns: tuple[Column, ...]
    figures: Mapping[str, Mapping[str, ValueWithInterval]]
    first: str
    differences: Mapping[str, Mapping[str, ValueWithInterval]]

    @staticmethod
    def of(
        records: Mapping[str, Sequence[Record]], columns: Sequence[Column], first: str = ""
    ) -> Tables:
        """Compute all figures from the records of each method; ``first`` is by default the
        first.
        """
        first = first or next(iter(records))
        figures = {name: {c.key: figure(own, c) for c in columns} for name, own in records.items()}
        kept = tuple(c for c in columns if any(own[c.key].count for own in figures.values()))
        apart = {
            name: {c.key: difference(records[first], own, c) for c in kept}
            for name, own in records.items()
            if name != first
        }
        return Tables(kept, figures, first, apart)

    def text(self, *, markdown: bool = False) -> str:
        """Return both tables, for a terminal or as Markdown."""
        draw = markdown_table if markdown else aligned_table
        parts = [draw(self._rows(self.figures, signed=False))]
        if self.differences:
            parts.append(f"Difference from {self.first}, on people whom both measure")
            parts.append(draw(self._rows(self.differences, signed=True)))
        return "\n\n".join(parts) + "\n"

    def _rows(
        self, shown: Mapping[str, Mapping[str, ValueWithInterval]], *, signed: bool
    ) -> list[list[str]]:
        rows = [["", *shown, "of"]]
        for column in self.columns:
            own = [figures[column.key] for figures in shown.values()]
            cells = [column.text(f, signed=signed) for f in own]
            if set(cells) != {"-"}:
                rows.append([column.label, *cells, str(max(f.count for f in own))])
        return rows


def check_results(folder: Path) -> None:
    """Raise OutputError if the results would replace a file of the user."""
    check_own(*(folder / name for name in FILES))


def write_results(
    tables: Tables,
    folder: Path,
    header: str,
    notes: Sequence[str],
    document: Mapping[str, Any],
) -> list[Path]:
    """Write table.txt, table.md and results.json, completely or not at all, and return their paths.

    Args:
        tables: of the figures.
        folder: for the files.
        header: a line over the tables.
        notes: sentences below the tables.
        document: of the JSON file, beside the figures.

    Raises:
        OutputError: the folder cannot be written, or has files of the user with these names.
    """
    check_results(check_writable(folder))
    found: dict[str, Any] = {"note": MARK, "header": header, "notes": list(notes), **document}
    found["columns"] = [
        {"key": c.key, "label": c.label, "definition": c.definition, "better": c.better}
        for c in tables.columns
    ]
    for name in ("figures", "differences"):
        by_method = getattr(tables, name)
        found[name] = {
            m: {key: asdict(f) for key, f in own.items()} for m, own in by_method.items()
        }
    text = tables.text()
    markdown = tables.text(markdown=True)
    lines = [*notes, MARK]
    texts = (
        f"{header}\n\n{text}\n" + "\n".join(lines) + "\n",
        f"{header}\n\n{markdown}\n"
        + "\n".join(f"- {' '.join(line.splitlines())}" for line in lines)
        + "\n",
        json.dumps(to_json(found, digits=9), indent=1) + "\n",
    )
    with atomic_write(folder) as temporary:
        for name, content in zip(FILES, texts, strict=True):
            temporary(name).write_text(content, encoding="utf-8")
    return [folder / name for name in FILES]
