"""The journal of a batch, one JSON line per attempt at a photo, only appended; and the tables made
from it.

The last line of an id counts. Lines of one file are in order of time. In several files, such as
those of shards, the line of the run with the larger number is the later one; clocks of machines may
differ. A damaged or truncated line is ignored and counted. The tables are the last line of each
photo, and of each person in them.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import ExitStack, suppress
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, BinaryIO

from filelock import FileLock, Timeout

from physic_batch.parquet import check_parquet, has_parquet, write_parquet
from physic_core.errors import OutputError
from physic_core.files import (
    atomic_write,
    check_own,
    csv_writer,
    finite,
    foreign_file,
    from_json,
    open_to_append,
    paths_inside,
    to_json,
    whole,
)
from physic_core.io.result_folder import PEOPLE_TABLE
from physic_core.types import MARKS, PERSON_COLUMNS, SUMMARY_COLUMNS

if TYPE_CHECKING:
    from physic_batch.photos import Shard

COLUMNS: Mapping[str, str] = {
    "id": "of the photo",
    "path": "absolute path of the photo",
    "state": '"done" or "failed"',
    "checks_failed": "names of the failed self-checks, separated by spaces",
    "error": "class of the error; empty if done",
    "message": "of the error",
    "seconds": "wall-clock time of this photo, without loading models",
    "peak_mb": "largest resident memory of the process so far, MB; empty if the photo failed",
    "attempts": "number of tries in this run",
    "finished": "end, UTC",
    "run": "number of the run in this folder",
    "photo": "SHA-256 of the file; empty if it cannot be read",
    "stamp": "of the file: size in bytes, times of the last change of content and of inode (ns "
    "since 1970), inode; empty if it cannot be found",
    "config": "digest of the settings that the result depends on, and of the files that they name",
    "save": "what was saved: pictures, numbers, people or none",
    "folder": "of the results, relative to the output folder; empty without files",
    "files": "names and sizes of the files, such as reconstruction.npz=2048 thumbnail=512",
    "result": "id of the run that wrote the files; empty without files",
    "version": "of metricbody",
    "plugins": "of the backends, with versions, and a digest of their code and libraries",
}
"""Columns of every row; rows of finished photos also have the numbers of
``Reconstruction.summary``, which tables have before "seconds".
"""

THUMBNAIL = "thumbnail"
"""Name of the thumbnail in the column ``files``."""

PEOPLE_COLUMN = "people_rows"
"""Entry of a finished photo with a row for each person, from which ``people.csv`` is written; no
table has it.
"""

_PEOPLE_START = f', "{PEOPLE_COLUMN}": '.encode()  # the last entry of its line
_ALWAYS = ("id", "state", "config", "finished")
NUMBERS = ("seconds", "peak_mb", "attempts", "run")
"""Columns of every row that are numbers; the others are texts."""

_FINITE = (*NUMBERS, "people")
_TEXTS = COLUMNS.keys() - set(NUMBERS)
_NUMBER = (float, int, NoneType)
_NON_FINITE = re.compile(rb'"(NaN|-?Infinity)"')
_MAX_OPEN = 256  # journals at a time: processes may have 1024 files
_END_BYTES = 1 << 20
_TABLE = "summary.csv"
_BEFORE_NUMBERS = tuple(COLUMNS)[: tuple(COLUMNS).index("seconds")]
# CSV has no comments: the mark is the start of the first line, which is the same in every version.
_SUMMARY_MARK = "id,path,state,"
_PEOPLE_COLUMNS = ("id", "path", *PERSON_COLUMNS)
_PEOPLE_MARK = "id,path,person,"
_PEOPLE_TEXTS = (
    *("id", "path"),
    *(name for name, column in PERSON_COLUMNS.items() if column.is_text),
)


def check_journal(path: Path) -> None:
    """Check that a file may become or stay a journal: it is missing or empty, or has a row.

    Raises:
        OutputError: it has none, or is a link.
    """
    check_own(path, mark="")
    if path.exists() and not _is_journal(path):
        raise foreign_file(path)


class Journal:
    """The journal file of one run, open for appending; only one process may have it open.

    Args:
        path: created if missing; its folder must exist.

    Raises:
        OutputError: it cannot be written, another process has it open, or it is a file of the user.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        check_journal(path)
        lock = path.with_suffix(".lock")
        check_own(lock, mark="")
        self._lock = FileLock(lock, blocking=False)
        try:
            self._lock.acquire()
            self._file = open_to_append(path)
            self._end_torn_line()
            self._run = 1 + max(map(_last_run, journal_files(path.parent)))
        except Timeout:
            raise OutputError(
                f"another batch is writing {path}: wait until it ends, or name another folder"
            ) from None
        except OSError as error:
            raise self._error(error) from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # a line that could not be written has been reported
            self._file.close()
        self._lock.release()

    def append(self, row: Mapping[str, Any]) -> None:
        """Write a row with the number of this run, and wait until it is on the disk.

        Raises:
            OutputError: the disk is full, or the file cannot be written.
        """
        row = {**row, "run": self._run}
        if PEOPLE_COLUMN in row:
            row[PEOPLE_COLUMN] = row.pop(PEOPLE_COLUMN)  # to the end of the line
        line = json.dumps(to_json(row, digits=9), ensure_ascii=True, allow_nan=False)
        try:
            self._file.write(f"{line}\n".encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._error(error) from error

    def _end_torn_line(self) -> None:
        size = self._file.seek(0, os.SEEK_END)
        if size:
            self._file.seek(size - 1)
            if self._file.read(1) != b"\n":
                self._file.write(b"\n")

    def _error(self, error: OSError) -> OutputError:
        return OutputError(
            f"cannot write the journal {self.path}: {error.strerror}; run the same "
            f"command again to resume"
        )


def journal_files(out: Path, shard: Shard | None = None) -> list[Path]:
    """Return the journals of an output folder; of a shard, without those of its sister shards,
    which have other photos.
    """
    there = paths_inside(out, (path.name for path in out.glob("journal*.jsonl")))
    files = sorted(filter(Path.is_file, there.values()))
    if shard is None:
        return files
    own = journal_name(shard)
    sister = re.compile(rf"journal-[0-9]+-of-{shard.count}\.jsonl")
    return [path for path in files if path.name == own or not sister.fullmatch(path.name)]


def journal_name(shard: Shard | None) -> str:
    """Return the name of the journal of a shard, or of a batch without shards."""
    return "journal.jsonl" if shard is None else f"journal-{shard.number}-of-{shard.count}.jsonl"


class JournalIndex:
    """Where the last row of each id is in journals; made in one pass, and holds no row.

    Attributes:
        damaged: number of lines that are no row: cut off, or with a value of another type.
    """

    def __init__(self, paths: Iterable[Path]) -> None:
        self.damaged = 0
        self._last: dict[str, tuple[int, float, Path, int, tuple[str, ...]]] = {}
        names: dict[tuple[str, ...], tuple[str, ...]] = {}
        for path in paths:
            start = 0
            with path.open("rb") as file:
                for line in file:
                    row = _parse_row(line, with_people=False)
                    if row is None:
                        self.damaged += 1
                    elif row["run"] >= self._last.get(row["id"], (0,))[0]:
                        keys = tuple(row)
                        keys = names.setdefault(keys, keys)
                        self._last[row["id"]] = (row["run"], -_usable_share(row), path, start, keys)
                    start += len(line)

    def ids(self) -> list[str]:
        """Return the ids, those with the largest share of usable marks first."""
        return sorted(self._last, key=lambda name: self._last[name][1:4])

    def columns(self) -> set[str]:
        """Return the names of all columns of the rows, without people."""
        return {name for keys in {last[4] for last in self._last.values()} for name in keys}

    def rows(
        self, ids: Iterable[str], *, with_people: bool = True
    ) -> Iterator[dict[str, Any] | None]:
        """Yield the last row of each of some ids; None for one that has none, or a damaged one.

        Args:
            ids: of photos.
            with_people: whether the rows have their people, whose parsing takes half of the time.
        """
        files: dict[Path, BinaryIO] = {}
        with ExitStack() as opened:
            for name in ids:
                if name not in self._last:
                    yield None
                    continue
                _, _, path, start, _ = self._last[name]
                if path not in files:
                    if len(files) == _MAX_OPEN:
                        opened.close()
                        files.clear()
                    files[path] = opened.enter_context(path.open("rb"))
                files[path].seek(start)
                row = _parse_row(files[path].readline(), with_people=with_people)
                self.damaged += row is None
                yield row


def _usable_share(row: Mapping[str, Any]) -> float:
    """Return the share of marks of people that are usable; -1 for a photo without people."""
    people = row.get("people")
    if not isinstance(people, int) or not people:
        return -1.0
    counts = (row.get(f"usable_{mark}") for mark in MARKS)
    return sum(one for one in counts if isinstance(one, int)) / (len(MARKS) * people)


def read_journals(folder: Path, columns: Iterable[str] | None = None) -> dict[str, dict[str, Any]]:
    """Return the last row of each id in all journals of a folder, or only some columns of it.

    An id can be in several journals after a change of shards; then the row of the later run counts.
    """
    index = JournalIndex(journal_files(folder))
    wanted = None if columns is None else {*columns, "id"}
    return {
        row["id"]: row if wanted is None else {name: row[name] for name in wanted & row.keys()}
        for row in index.rows(index.ids())
        if row is not None
    }


def _last_run(path: Path) -> int:
    """Return the number of the last run in a journal, from its end; 0 without rows."""
    size = path.stat().st_size
    with path.open("rb") as file:
        for length in (min(size, _END_BYTES), size):
            file.seek(size - length)
            for line in reversed(file.read().splitlines()):
                if (row := _parse_row(line, with_people=False)) is not None:
                    return int(row["run"])
    return 0


def _is_journal(path: Path) -> bool:
    with path.open("rb") as file:
        return any(_parse_row(line) is not None for line in file) or path.stat().st_size == 0


def _parse_row(line: bytes, *, with_people: bool = True) -> dict[str, Any] | None:
    """Return the row of a line, or its columns without people; None if it is damaged."""
    # No text has these bytes, since it has no quotation mark without a backslash.
    head, mark, people = line.rstrip().partition(_PEOPLE_START)
    try:
        row = _DECODER.decode((head + b"}" if mark and not with_people else line).decode())
        if mark and not people.endswith(b"]}"):
            return None
        return _with_types(row, convert_people=_NON_FINITE.search(people) is not None)
    except (ValueError, RecursionError):
        return None


def _with_types(row: Any, *, convert_people: bool) -> dict[str, Any]:
    """Return a row with numbers in place of "NaN" and infinities.

    Raises:
        ValueError: a value has another type than its column.
    """
    if not isinstance(row, dict) or not all(isinstance(row.get(name), str) for name in _ALWAYS):
        raise ValueError
    for name, value in row.items():
        if name in _TEXTS:
            is_valid = isinstance(value, str)
        elif isinstance(value, _NUMBER):
            continue
        elif isinstance(value, str):
            row[name] = from_json(value)
            is_valid = not value or row[name] != value
        else:
            is_valid = (
                name == PEOPLE_COLUMN
                and isinstance(value, list)
                and all(isinstance(one, dict) for one in value)
            )
            if convert_people:
                row[name] = from_json(value)
        if not is_valid:
            raise ValueError
    if any(isinstance(number := row.get(name), float) and not isfinite(number) for name in _FINITE):
        raise ValueError
    row["run"] = row["run"] if isinstance(row.get("run"), int) else 0
    return row


def _refuse(word: str) -> Any:
    raise ValueError(word)


_DECODER = json.JSONDecoder(parse_constant=_refuse, parse_float=finite, parse_int=whole)


def all_columns() -> tuple[str, ...]:
    """Return the columns that tables can have, in their order."""
    from physic_core.judge import CHECKS

    return _ordered_columns(
        {*SUMMARY_COLUMNS, *(f"check_{name}" for name in CHECKS)} - COLUMNS.keys()
    )


def _ordered_columns(numbers: Set[str]) -> tuple[str, ...]:
    """Return the columns of a table: the photo, the numbers of its result, time,
    memory and files, and at the end the values of the checks, by name.
    """
    known = (name for name in SUMMARY_COLUMNS if name in numbers)
    return tuple(dict.fromkeys((*_BEFORE_NUMBERS, *known, *COLUMNS, *sorted(numbers))))


def check_tables(out: Path) -> None:
    """Raise OutputError if a table of a batch would replace a file that PhySIC has not written."""
    check_own(out / _TABLE, mark=_SUMMARY_MARK)
    check_own(out / PEOPLE_TABLE, mark=_PEOPLE_MARK)
    for path in _parquet_tables(out):
        check_parquet(path)


def _parquet_tables(out: Path) -> list[Path]:
    """Return the tables that are written beside those of CSV; none without pyarrow."""
    names = (_TABLE, PEOPLE_TABLE) if has_parquet() else ()
    return [(out / name).with_suffix(".parquet") for name in names]


def write_tables(out: Path, index: JournalIndex | None = None) -> list[Path]:
    """Write ``summary.csv``, one row for each photo, and ``people.csv``, one for each person;
    where pyarrow is installed, both also as Parquet. Return their paths.

    Photos with the largest share of usable marks come first. Numbers of results are empty for
    failed photos. People are in the order of the photos' rows. Texts of CSV are those of
    :func:`physic_core.files.text.csv_writer`.

    Args:
        out: folder of the batch.
        index: of its journals; None to make it.

    Raises:
        OutputError: a file cannot be written, or no batch has written the one there.
    """
    check_tables(out)
    index = index or JournalIndex(journal_files(out))
    others = _parquet_tables(out)
    columns = _ordered_columns(index.columns() - COLUMNS.keys() - {PEOPLE_COLUMN})
    kept: tuple[list[Mapping[str, Any]], list[Mapping[str, Any]]] = [], []
    with atomic_write(out) as temporary:
        with (
            temporary(_TABLE).open("w", newline="", encoding="utf-8") as table,
            temporary(PEOPLE_TABLE).open("w", newline="", encoding="utf-8") as people_table,
        ):
            writers = csv_writer(table, columns), csv_writer(people_table, _PEOPLE_COLUMNS)
            for row in filter(None, index.rows(index.ids())):
                photo_columns = {"id": row["id"], "path": row.get("path", "")}
                people = [{**photo_columns, **one} for one in row.pop(PEOPLE_COLUMN, None) or ()]
                for write, rows_of_writer, rows in zip(writers, ([row], people), kept, strict=True):
                    for one in rows_of_writer:
                        write(one)
                    rows += rows_of_writer if others else []
        headers = (columns, _TEXTS), (_PEOPLE_COLUMNS, _PEOPLE_TEXTS)
        for path, header, rows in zip(others, headers, kept, strict=False):
            write_parquet(temporary(path.name), header[0], rows, header[1])
    return [out / _TABLE, out / PEOPLE_TABLE, *others]
