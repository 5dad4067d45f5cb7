"""The journal of a batch: one JSON line per photo that was tried, appended and never changed.

The last line of an id counts. Lines of one file follow each other in time; of several files, as shards have them, the
line of the run with the larger number is the later one. No clock decides: machines may have different ones. A damaged
or truncated line is ignored.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from physic_core.errors import OutputError
from physic_core.files.own import foreign_file, open_to_append
from physic_core.files.strict_json import from_json, parse_json, to_json

COLUMNS: Mapping[str, str] = {
    "id": "of the photo",
    "path": "absolute path of the photo",
    "state": '"done" or "failed"',
    "error": "class of the error; empty if done",
    "message": "of the error",
    "seconds": "wall-clock time of this photo, without loading models",
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
    "result": "SHA-256 of the arrays; empty without files",
    "version": "of physic-core",
    "grade": "of the result: good, doubtful or bad",
    "checks_failed": "names of the failed self-checks, separated by spaces",
    "peak_mb": "largest resident memory of the process so far, MB; empty if the photo failed",
}
"""Columns of every row; rows of finished photos also have the numbers of ``Reconstruction.summary``."""

PEOPLE_COLUMN = "people_rows"
"""Entry of a finished photo with a row for each person, from which ``people.csv`` is written; no table has it."""


_ALWAYS = ("id", "state", "config", "finished")


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
        with ExitStack() as opened:
            try:
                self._lock = opened.enter_context(FileLock(path.with_suffix(".lock"), blocking=False))
                self._file = opened.enter_context(open_to_append(path))
                self._end_torn_line()
                self._run = 1 + read_journals(path.parent, ()).run
            except Timeout:
                raise OutputError(
                    f"another batch is writing {path}: wait for its end, or name another folder"
                ) from None
            except OSError as error:
                raise self._error(error) from error
            opened.pop_all()

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
        line = json.dumps(to_json({**row, "run": self._run}, digits=9), ensure_ascii=True, allow_nan=False)
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
            f"cannot write the journal {self.path}: {error.strerror}; the same command goes on from here later"
        )


@dataclass(frozen=True)
class JournalRows:
    """Rows of all journals of a folder.

    Attributes:
        last: the last row of each id.
        damaged: number of damaged or truncated lines.
        run: largest number of a run; 0 without rows.
    """

    last: Mapping[str, dict[str, Any]]
    damaged: int
    run: int = 0


def read_journals(folder: Path, columns: Iterable[str] | None = None) -> JournalRows:
    """Read all journals of a folder, or only some columns of them.

    An id can be in several journals after a change of shards; then the row of the later run counts.
    """
    found: dict[str, dict[str, Any]] = {}
    places: dict[str, _Place] = {}
    damaged = last_run = 0
    wanted = None if columns is None else {*columns, "id"}
    for place, row in _lines(folder):
        if row is None:
            damaged += 1
            continue
        item = row["id"]
        last_run = max(last_run, place.run)
        if item not in places or place.follows(places[item]):
            places[item] = place
            found[item] = row if wanted is None else {name: row[name] for name in wanted & row.keys()}
    return JournalRows(found, damaged, last_run)


def last_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the last row of each id, without holding all rows in memory."""
    last: dict[str, _Place] = {}
    for place, row in _lines(folder):
        if row is not None and (row["id"] not in last or place.follows(last[row["id"]])):
            last[row["id"]] = place
    for place, row in _lines(folder):
        if row is not None and last.get(row["id"]) == place:
            yield row


@dataclass(frozen=True, slots=True)
class _Place:
    """Of a line: name of the file, number of the line, and number of the run that wrote it, 0 if unknown."""

    file: str
    line: int
    run: int

    def follows(self, other: _Place) -> bool:
        """Whether this line is later than one that was read before; files are read in the order of their names."""
        return self.file == other.file or self.run >= other.run


def _lines(folder: Path) -> Iterator[tuple[_Place, dict[str, Any] | None]]:
    """Yield the place and the row of each line; None for a damaged or truncated line."""
    for path in sorted(filter(Path.is_file, folder.glob("journal*.jsonl"))):
        with path.open("rb") as file:
            for number, line in enumerate(file):
                row = _row(line)
                run = 0 if row is None else row.get("run")
                yield _Place(path.name, number, run if isinstance(run, int) else 0), row


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
    return found if all(isinstance(found.get(name), str) for name in _ALWAYS) else None
