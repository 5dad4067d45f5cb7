"""Write the last rows of all photos as one table, CSV or Parquet, for which it imports pyarrow, and those of people."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

from physic_core.batch.journal import COLUMNS, PEOPLE_COLUMN, last_rows
from physic_core.errors import PackageMissingError
from physic_core.files.atomic import atomic_write
from physic_core.files.csv_rows import as_utf8, write_csv
from physic_core.files.own import MARK, check_own
from physic_core.io.people_table import PEOPLE_MARK
from physic_core.io.result_folder import PEOPLE_TABLE
from physic_core.types.person_rows import PERSON_COLUMNS


def import_pyarrow(purpose: str) -> Any:
    """Import ``pyarrow.parquet``.

    Raises:
        PackageMissingError: it is not installed; ``purpose`` begins the message.
    """
    try:
        return importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise PackageMissingError(
            f"{purpose} needs pyarrow: pip install pyarrow, or use a CSV file (--table csv)"
        ) from error


_INTEGERS = ("attempts", "run", "bytes", "modified")
_NUMBERS = ("seconds", "peak_mb")
_ROWS = 10_000  # of one group of a Parquet file
_MARKS = {"csv": ",".join(COLUMNS), "parquet": MARK}  # CSV has no comments: its first line is the mark


def choose_table(out: Path, kind: str | None) -> str:
    """Return the kind of the table of photos, after a check that both tables of a batch can be written.

    Args:
        out: folder of the batch.
        kind: "csv" or "parquet"; None for "parquet" where pyarrow is installed.

    Raises:
        PackageMissingError: pyarrow is not installed.
        OutputError: a file of the user has the name of a table.
    """
    kind = kind or ("csv" if find_spec("pyarrow") is None else "parquet")
    if kind == "parquet":
        import_pyarrow("summary.parquet")
    check_own(out / f"summary.{kind}", mark=_MARKS[kind])
    check_own(out / PEOPLE_TABLE, mark=PEOPLE_MARK)
    return kind


def all_columns() -> tuple[str, ...]:
    """Return the columns that tables can have: those of the journal, then the numbers of all results."""
    from physic_core.pipeline.checks import CHECKS
    from physic_core.types.results import SUMMARY_KEYS

    return (*COLUMNS, *(n for n in SUMMARY_KEYS if n not in COLUMNS), *(f"check_{name}" for name in CHECKS))


def arrow_schema(columns: Iterable[str]) -> Any:
    """Return the ``pyarrow.Schema`` of columns; columns that the journal does not have are numbers."""
    import pyarrow as pa

    def kind(name: str) -> Any:
        if name in _INTEGERS:
            return pa.int64()
        return pa.string() if name in COLUMNS and name not in _NUMBERS else pa.float64()

    return pa.schema([(name, kind(name)) for name in columns])


def write_table(out: Path, kind: str) -> Path:
    """Write ``summary.parquet`` or ``summary.csv``, one row for each photo, and return its path.

    Columns are those of the journal, then the numbers of the results, which are empty for failed photos. Texts of a CSV
    file are those of :func:`physic_core.files.csv_rows.write_csv`.

    Raises:
        ConfigError: pyarrow is not installed.
        OutputError: the file cannot be written, or no batch has written the one there.
    """
    check_own(out / f"summary.{kind}", mark=_MARKS[kind])
    numbers = sorted({name for row in last_rows(out) for name in row} - COLUMNS.keys() - {PEOPLE_COLUMN})
    name = f"summary.{kind}"
    with atomic_write(out) as temporary:
        path = temporary(name)
        if kind == "parquet":
            _write_parquet(path, last_rows(out), numbers)
        else:
            with path.open("w", newline="", encoding="utf-8") as file:
                write_csv(file, [*COLUMNS, *numbers], last_rows(out))
    return out / name


def write_people_table(out: Path) -> Path:
    """Write ``people.csv``, one row for each person, in the order of the photos' rows, and return its path.

    Raises:
        OutputError: the file cannot be written, or PhySIC has not written the one there.
    """
    check_own(out / PEOPLE_TABLE, mark=PEOPLE_MARK)
    people = ({"photo": row["id"], **one} for row in last_rows(out) for one in row.get(PEOPLE_COLUMN) or ())
    with atomic_write(out) as temporary, temporary(PEOPLE_TABLE).open("w", newline="", encoding="utf-8") as file:
        write_csv(file, list(PERSON_COLUMNS), people)
    return out / PEOPLE_TABLE


def _write_parquet(path: Path, rows: Iterator[dict[str, Any]], numbers: list[str]) -> None:
    parquet = import_pyarrow("summary.parquet")
    import pyarrow as pa

    schema = arrow_schema((*COLUMNS, *numbers)).with_metadata({"note": MARK})
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while group := list(islice(rows, _ROWS)):
            columns = {name: [as_utf8(row.get(name)) for row in group] for name in schema.names}
            for name in (*numbers, *_NUMBERS):
                columns[name] = [None if value is None else float(value) for value in columns[name]]
            writer.write_table(pa.table(columns, schema=schema))
