"""The tables of a batch as Parquet beside CSV, where pyarrow is installed."""

from __future__ import annotations

from collections.abc import Collection
from importlib.util import find_spec
from pathlib import Path

from physic_core.files import foreign_file

_MARK = b"physic"


def has_parquet() -> bool:
    """Return whether pyarrow is installed."""
    return find_spec("pyarrow") is not None


def check_parquet(path: Path) -> None:
    """Raise OutputError if a table would replace a file that PhySIC has not written."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.exists() and not path.is_symlink():
        return
    try:
        is_own = not path.is_symlink() and _MARK in (pq.read_schema(path).metadata or {})
    except (OSError, pa.ArrowInvalid):
        is_own = False
    if not is_own:
        raise foreign_file(path)


def write_parquet(path: Path, table: Path, texts: Collection[str]) -> None:
    """Write a CSV table as Parquet.

    Args:
        path: of the new file.
        table: of the CSV file.
        texts: names of the columns of texts, which may all be empty.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow import csv

    with table.open(encoding="utf-8") as lines:
        names = lines.readline().rstrip("\r\n").split(",")
    rows = csv.read_csv(
        table,
        parse_options=csv.ParseOptions(newlines_in_values=True),
        convert_options=csv.ConvertOptions(
            column_types={name: pa.string() for name in names if name in texts},
            strings_can_be_null=True,
        ),
    )
    fields = [
        pa.field(one.name, pa.float64() if pa.types.is_null(one.type) else one.type)
        for one in rows.schema
    ]
    pq.write_table(rows.cast(pa.schema(fields, {_MARK: b"1"})), path)
