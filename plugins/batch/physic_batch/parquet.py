"""The tables of a batch as Parquet beside CSV, where pyarrow is installed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from physic_core.files import check_own, foreign_file

_MARK = b"physic"


def has_parquet() -> bool:
    """Return whether pyarrow is installed."""
    return find_spec("pyarrow") is not None


def check_parquet(path: Path) -> None:
    """Raise OutputError if a table would replace a file that PhySIC has not written."""
    import pyarrow.parquet as pq

    check_own(path, mark="")
    is_own = not path.exists()
    with suppress(Exception):  # pyarrow raises a dozen classes
        is_own = is_own or _MARK in (pq.read_schema(path).metadata or {})
    if not is_own:
        raise foreign_file(path)


def write_parquet(
    path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]], texts: Collection[str]
) -> None:
    """Write rows as Parquet; a value that is missing, None or an empty text is null.

    Args:
        path: of the new file.
        columns: their names; other entries of a row are skipped.
        rows: of the table.
        texts: names of the columns of texts, which may all be empty.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {}
    for name in columns:
        values = [None if (value := row.get(name)) == "" else value for row in rows]
        present_values = [value for value in values if value is not None]
        kinds = {type(value) for value in present_values}
        if name in texts or not kinds <= {int, float, bool} or any(map(_is_large, present_values)):
            arrays[name] = pa.array([_text(value) for value in values], pa.string())
        elif kinds in ({bool}, {int}):
            arrays[name] = pa.array(values)
        else:
            numbers = [None if value is None else float(value) for value in values]
            arrays[name] = pa.array(numbers, pa.float64())
    pq.write_table(pa.table(arrays).replace_schema_metadata({_MARK: b"1"}), path)


def _is_large(value: float) -> bool:
    return isinstance(value, int) and abs(value) >= 1 << 63


def _text(value: Any) -> str | None:
    """Return a text in UTF-8; bytes of a file's name that are not are written as in the journal."""
    return None if value is None else str(value).encode("utf-8", "backslashreplace").decode()
