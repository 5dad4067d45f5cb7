"""The journal of a batch, one JSON line per attempt at a photo, only appended; and the tables made
from it.

The last line of an id counts. Lines of one file are in order of time. In several files, such as
those of shards, the line of the run with the larger number is the later one; clocks of machines may
differ. A damaged or truncated line is ignored. The tables are the last line of each photo, and of
each person in them.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from physic_core.errors import OutputError
from physic_core.files.atomic import atomic_write, check_own, foreign_file, open_to_append
from physic_core.files.text import from_json, parse_json, to_json, write_csv
from physic_core.io.result_folder import PEOPLE_TABLE
from physic_core.types.results import PERSON_COLUMNS, SUMMARY_KEYS

COLUMNS: Mapping[str, str] = {
    "id": "of the photo",
    "path": "absolute path of the photo",
    "state": '"done" or "failed"',
    "grade": "of the result: good, doubtful or bad",
    "trust": "probability that all main people are right; empty without people",
    "checks_failed": "names of the failed self-checks, separated by spaces",
    "error": "class of the error; empty if done",
    "message": "of the error",
    "seconds": "wall-clock time of this photo, without loading models",
    "peak_mb": "largest resident memory of the process so far, MB; empty if the photo failed",
    "attempts": "number of tries in this run",
    "finished": "end, UTC",
    "run": "number of the run in this folder",
    "photo": "SHA-256 of the file; empty if it cannot be read",
    "bytes": "size of the file; empty if it cannot be found",
    "modified": "modification time of the file, ns since 1970",
    "config": "digest of the settings that the result depends on",
    "save": "what was saved: pictures, numbers, people or none",
    "folder": "of the results, relative to the output folder; empty without files",
    "files": "names and sizes of the files, such as reconstruction.npz=2048 thumbnail=512",
    "result": "run that wrote the files, as they state it; empty without files",
    "version": "of physic-core",
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

_ALWAYS = ("id", "state", "config", "finished")
_TABLE = "summary.csv"
_BEFORE_NUMBERS = tuple(COLUMNS)[: tuple(COLUMNS).index("seconds")]
_MARK = ",".join(_BEFORE_NUMBERS)  # CSV has no comments: the start of its first line is the mark
_PEOPLE_COLUMNS = ("id", "path", *(name for name in PERSON_COLUMNS if name != "id"))
_PEOPLE_MARK = ",".join(_PEOPLE_COLUMNS)


def check_journal(path: Path) -> None:
    """Check that a file may become or stay a journal: it is missing or empty, or has a row.

    Raises:
        OutputError: it has none, or is a link.
    """
    if os.path.lexists(path) and (not path.is_file() or path.is_symlink() or not _is_journal(path)):
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
        self._lock = FileLock(path.with_suffix(".lock"), blocking=False)
        try:
            self._lock.acquire()
            self._file = open_to_append(path)
            self._end_torn_line()
            self._run = 1 + max((row["run"] for _, _, row in _lines(path.parent)), default=0)
        except Timeout:
            raise OutputError(
                f"another batch is writing {path}: wait for its end, or name another folder"
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
        line = json.dumps(
            to_json({**row, "run": self._run}, digits=9), ensure_ascii=True, allow_nan=False
        )
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
            f"cannot write the journal {self.path}: {error.strerror}; the same command goes on "
            f"from here later"
        )


def read_journals(folder: Path, columns: Iterable[str] | None = None) -> dict[str, dict[str, Any]]:
    """Return the last row of each id in all journals of a folder, or only some columns of it.

    An id can be in several journals after a change of shards; then the row of the later run counts.
    """
    found: dict[str, dict[str, Any]] = {}
    runs: dict[str, int] = {}
    wanted = None if columns is None else {*columns, "id"}
    for _, _, row in _lines(folder):
        if row["run"] >= runs.get(row["id"], 0):
            runs[row["id"]] = row["run"]
            found[row["id"]] = (
                row if wanted is None else {name: row[name] for name in wanted & row.keys()}
            )
    return found


def last_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the last row of each id, the most trusted first and those without trust last, without
    holding all rows in memory.
    """
    last: dict[str, tuple[int, float, Path, int]] = {}
    for path, start, row in _lines(folder):
        if row["run"] >= last.get(row["id"], (0,))[0]:
            trust = row.get("trust")
            mistrust = -trust if isinstance(trust, float) else 1.0
            last[row["id"]] = (row["run"], mistrust, path, start)
    for _, _, path, start in sorted(last.values(), key=lambda place: place[1:]):
        with path.open("rb") as file:
            file.seek(start)
            found = _row(file.readline())
        if found is not None:
            yield found


def _lines(folder: Path) -> Iterator[tuple[Path, int, dict[str, Any]]]:
    """Yield file and first byte of each line, and its row; a damaged or truncated line is
    skipped.
    """
    for path in sorted(filter(Path.is_file, folder.glob("journal*.jsonl"))):
        with path.open("rb") as file:
            start = 0
            for line in file:
                if (row := _row(line)) is not None:
                    yield path, start, row
                start += len(line)


def _is_journal(path: Path) -> bool:
    with path.open("rb") as file:
        return any(_row(line) is not None for line in file) or path.stat().st_size == 0


def _row(line: bytes) -> dict[str, Any] | None:
    try:
        row = parse_json(line)
    except ValueError:
        return None
    if not isinstance(row, dict):
        return None
    found = {name: from_json(value) for name, value in row.items()}
    found["run"] = found["run"] if isinstance(found.get("run"), int) else 0
    return found if all(isinstance(found.get(name), str) for name in _ALWAYS) else None


def all_columns() -> tuple[str, ...]:
    """Return the columns that tables can have, in their order."""
    from physic_core.pipeline.checks import CHECKS

    return _in_order({*SUMMARY_KEYS, *(f"check_{name}" for name in CHECKS)} - COLUMNS.keys())


def _in_order(numbers: Set[str]) -> tuple[str, ...]:
    """Return the columns of a table: the photo and its grade, the numbers of its result, time,
    memory and files, and at the end the values of the checks, by name.
    """
    known = (name for name in SUMMARY_KEYS if name in numbers)
    return tuple(dict.fromkeys((*_BEFORE_NUMBERS, *known, *COLUMNS, *sorted(numbers))))


def check_tables(out: Path) -> None:
    """Raise OutputError if a table of a batch would replace a file that PhySIC has not written."""
    check_own(out / _TABLE, mark=_MARK)
    check_own(out / PEOPLE_TABLE, mark=_PEOPLE_MARK)


def write_tables(out: Path) -> list[Path]:
    """Write ``summary.csv``, one row for each photo, and ``people.csv``, one for each person;
    return their paths.

    Photos with the highest trust come first. Numbers of results are empty for failed photos. People
    are in the order of the photos' rows.
    Texts are those of :func:`physic_core.files.text.write_csv`.

    Raises:
        OutputError: a file cannot be written, or no batch has written the one there.
    """
    check_tables(out)
    numbers = {name for row in last_rows(out) for name in row} - COLUMNS.keys() - {PEOPLE_COLUMN}
    people = (
        {"id": row["id"], "path": row.get("path", ""), **one}
        for row in last_rows(out)
        for one in row.get(PEOPLE_COLUMN) or ()
    )
    tables = ((_TABLE, _in_order(numbers), last_rows(out)), (PEOPLE_TABLE, _PEOPLE_COLUMNS, people))
    for name, columns, rows in tables:
        with (
            atomic_write(out) as temporary,
            temporary(name).open("w", newline="", encoding="utf-8") as file,
        ):
            write_csv(file, columns, rows)
    return [out / name for name, _, _ in tables]
