"""The journal of a batch: one JSON line per photo that was tried, appended and never changed.

The last line of an id counts. Each line has a checksum; a line that is damaged or cut off, by a crash or a full disk,
is ignored, and so is what a damaged line could have replaced: see :class:`JournalRows`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physic_core.errors import OutputError
from physic_core.files.atomic import sync_folder
from physic_core.files.document_checksum import ChecksumState, checksum_state, with_checksum
from physic_core.files.locks import try_lock
from physic_core.files.strict_json import from_json, parse_json, to_json

__all__ = ["COLUMNS", "Journal", "JournalRows", "last_rows", "read_journals", "read_rows"]

COLUMNS: Mapping[str, str] = {
    "id": "of the photo",
    "path": "absolute path of the photo",
    "state": '"done" or "failed"',
    "error": "class of the error; empty if done. Timeout and WorkerDied are those of the batch itself",
    "message": "of the error",
    "seconds": "wall-clock time of this photo, without loading models",
    "attempts": "how often it was tried in this run: a photo whose worker dies is tried twice",
    "finished": "end, UTC",
    "photo": "SHA-256 of the file; empty if it cannot be read",
    "bytes": "size of the file",
    "modified": "modification time of the file, ns since 1970",
    "config": "digest of the settings that results depend on, with those of this photo alone",
    "save": "what was saved: full, numbers, people or summary, and +preview, +glb or +report",
    "folder": "of the results, relative to the output folder; empty without files",
    "result": "SHA-256 of the arrays in the photo's folder, or of its picture if there are none; empty without files",
    "version": "of physic-core",
    "grade": "of the result: good, doubtful or bad",
    "checks_failed": "names of the failed self-checks, separated by spaces",
    "peak_mb": "largest resident memory of the process so far, MB; empty if the photo failed",
}
"""Columns of every row; rows of finished photos also have the numbers of ``Reconstruction.summary``."""


_ALWAYS = ("id", "state", "config", "finished")


class Journal:
    """The journal file of one run, open for appending; only one process may have it open.

    Args:
        path: created if missing; its folder must exist.

    Raises:
        OutputError: it cannot be written, or another process has it open.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with ExitStack() as opened:
            try:
                self._lock = opened.enter_context(path.with_suffix(".lock").open("ab"))
                if try_lock(self._lock.fileno()) is False:
                    raise OutputError(f"another batch is writing {path}: wait for its end, or name another folder")
                self._file = opened.enter_context(path.open("ab+"))
                self._end_torn_line()
                sync_folder(path.parent)
            except OSError as error:
                raise self._error(error) from error
            opened.pop_all()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # a line that could not be written has been reported
            self._file.close()
        self._lock.close()

    def append(self, row: Mapping[str, Any]) -> None:
        """Write a row, and wait until it is on the disk.

        Raises:
            OutputError: the disk is full, or the file cannot be written.
        """
        line = json.dumps(with_checksum(to_json(row, digits=9)), ensure_ascii=True, allow_nan=False) + "\n"
        try:
            self._file.write(line.encode())
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
        damaged: number of lines that are damaged or cut off.
        unsure: ids of failed photos that were perhaps done later, in a line that is damaged.
    """

    last: Mapping[str, dict[str, Any]]
    damaged: int
    unsure: frozenset[str]


def read_rows(folder: Path, columns: Iterable[str] | None = None) -> Mapping[str, dict[str, Any]]:
    """Read the last row of each id from all journals of a folder, or only some columns of it."""
    return read_journals(folder, columns).last


def read_journals(folder: Path, columns: Iterable[str] | None = None) -> JournalRows:
    """Read all journals of a folder, or only some columns of them.

    An id can be in several journals after a change of shards; then the row that was finished last counts.
    """
    found: dict[str, dict[str, Any]] = {}
    failed: set[str] = set()
    unsure: set[str] = set()
    damaged = 0
    wanted = None if columns is None else {*columns, "id", "finished"}
    for row in _lines(folder):
        if row is None:
            damaged += 1
            unsure |= failed
            continue
        before = found.get(row["id"])
        if before is None or str(row.get("finished", "")) >= str(before.get("finished", "")):
            found[row["id"]] = row if wanted is None else {name: row[name] for name in wanted & row.keys()}
            unsure.discard(row["id"])
            (failed.add if row["state"] == "failed" else failed.discard)(row["id"])
    return JournalRows(found, damaged, frozenset(unsure))


def last_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the last row of each id, without holding all rows in memory."""
    last = {item: row.get("finished") for item, row in read_rows(folder, ()).items()}
    for row in _lines(folder):
        if row is not None and last.get(row["id"]) == row.get("finished") and last.pop(row["id"], None) is not None:
            yield row


def _lines(folder: Path) -> Iterator[dict[str, Any] | None]:
    """Yield the row of each line; None for a line that is damaged or cut off."""
    for path in sorted(folder.glob("journal*.jsonl")):
        with path.open("rb") as file:
            for line in file:
                yield _row(line)


def _row(line: bytes) -> dict[str, Any] | None:
    try:
        row = parse_json(line)
    except ValueError:
        return None
    if not isinstance(row, dict) or checksum_state(row) is not ChecksumState.RIGHT:
        return None
    found = {name: from_json(value) for name, value in row.items() if name != "checksum"}
    return found if all(isinstance(found.get(name), str) for name in _ALWAYS) else None
