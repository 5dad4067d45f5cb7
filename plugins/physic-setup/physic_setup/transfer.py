"""Download a file over HTTP and resume an interrupted download."""

from __future__ import annotations

import errno
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from filelock import lock_descriptor

from physic_core.errors import DownloadError
from physic_core.weights.locate import format_size

__all__ = ["ByteProgress", "ResumableDownload", "require_room", "wrap_write_errors", "write_error"]

ByteProgress = Callable[[int, int | None], None]
"""Callback with the bytes downloaded so far, and the total if known."""

_CHUNK = 1 << 16  # bytes that a broken connection can lose
_CONNECT_SECONDS, _READ_SECONDS = 20.0, 60.0
_MAX_TRIES = 5
_RANGE = re.compile(r"bytes (\d+)-")


class _ConnectionBroken(Exception):
    """The connection ended before the download was complete."""


class _RemoteFileChanged(Exception):
    """The partial download belongs to another version of the remote file."""


@dataclass(frozen=True)
class ResumableDownload:
    """A download that goes on from a partial one.

    A ``.part`` file has the partial content. A ``.part.of`` file beside it has the address and ETag of the remote file.
    Without a hash or an ETag, the download starts again, since the remote file may have changed.

    Attributes:
        part: path of the partial file.
        size: expected size in bytes, if known.
        hashed: whether the caller verifies a hash of the complete file.
        tag: ETag of the expected version, if known.
        headers: HTTP headers of the request.
        advice: text for the error if the server refuses the request or does not have the file.
    """

    part: Path
    size: int | None = None
    hashed: bool = False
    tag: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    advice: str = ""
    report: ByteProgress = lambda done, total: None

    def fetch(
        self, url: str, target: Path, find_fault: Callable[[Path], str], advice: str = "", name: str = ""
    ) -> None:
        """Download ``url`` to a file, or resume its download, and verify it.

        Args:
            url: of the file.
            target: where the complete file goes.
            find_fault: returns what is wrong with the complete file; "" if nothing is.
            advice: for the message about a fault.
            name: of the file in that message; ``url`` by default.

        Raises:
            DownloadError: the download failed, and the partial file is kept; or the file is wrong, and removed.
        """
        self._download(url)
        if wrong := find_fault(self.part):
            self.discard()
            end = f"; {advice}" if advice else ""
            raise DownloadError(f"{name or url} was downloaded, but {wrong}: removed{end}")
        with wrap_write_errors(target):
            os.replace(self.part, target)
            self._identity_file.unlink(missing_ok=True)

    def _download(self, url: str) -> None:
        tries, restarted = 0, False
        while True:
            before = self._bytes_here()
            try:
                self._download_once(url)
                return
            except _RemoteFileChanged as error:
                self.discard()
                if restarted:
                    raise DownloadError(f"{url} changes during the download: try again later") from error
                restarted = True
            except _ConnectionBroken as error:
                tries += 1
                if self._bytes_here() <= before or tries == _MAX_TRIES:
                    raise DownloadError(f"{url}: {error}{self._kept_text()}") from error
                time.sleep(1.0)  # the router or server may restart

    def discard(self) -> None:
        """Delete the partial file."""
        with wrap_write_errors(self.part):
            self.part.unlink(missing_ok=True)
            self._identity_file.unlink(missing_ok=True)

    @property
    def _identity_file(self) -> Path:
        return self.part.with_name(self.part.name + ".of")

    def _bytes_here(self) -> int:
        return self.part.stat().st_size if self.part.is_file() else 0

    def _kept_text(self) -> str:
        here = self._bytes_here()
        return f"; {format_size(here)} are kept; the next download resumes" if here else ""

    def _download_once(self, url: str) -> None:
        """Download the rest of the file over one connection."""
        import requests

        have, validator = self._resume_from(url)
        if self.size is not None and have == self.size:
            self.report(have, self.size)
            return
        headers = {"Accept-Encoding": "identity", **self.headers}
        if have:
            headers["Range"] = f"bytes={have}-"
            if validator:
                headers["If-Range"] = validator
        try:
            with requests.get(url, headers=headers, stream=True, timeout=(_CONNECT_SECONDS, _READ_SECONDS)) as answer:
                if have and answer.status_code == 416 and answer.headers.get("Content-Range", "") == f"bytes */{have}":
                    return  # the partial file is complete
                if have and (
                    answer.status_code == 416 or (answer.status_code == 206 and not _continues_at(answer, have))
                ):
                    raise _RemoteFileChanged
                if answer.status_code == 200:
                    have = 0
                self._check_status(url, answer)
                total = _total_bytes(answer, have)
                if self.size is not None and total not in (None, self.size):
                    raise DownloadError(
                        f"{url} has {total} bytes, but the manifest states {self.size}: the file has changed"
                        f"{_append_advice(self.advice)}"
                    )
                self._write(url, answer, have, total if total is not None else self.size)
        except requests.exceptions.RequestException as error:
            raise _ConnectionBroken(_describe_connection_error(error)) from error

    def _resume_from(self, url: str) -> tuple[int, str]:
        """Return how many bytes of the partial file can be kept, and the ETag stored with them."""
        have = self._bytes_here()
        if not have:
            return 0, ""
        lines = self._identity_file.read_text("utf-8").splitlines() if self._identity_file.is_file() else []
        source, tag = [*lines, "", ""][:2]
        same = source == url and (not self.tag or tag == self.tag) and (self.size is None or have <= self.size)
        if not same or not (self.hashed or tag):
            return 0, ""
        return have, "" if self.tag else tag

    def _check_status(self, url: str, answer: Any) -> None:
        code = answer.status_code
        if code in (200, 206):
            return
        if code in (401, 403, 407):
            raise DownloadError(f"{url} refuses access (HTTP {code}){_append_advice(self.advice)}")
        if code in (404, 410):
            raise DownloadError(f"{url} does not exist (HTTP {code}){_append_advice(self.advice)}")
        raise DownloadError(
            f"{url} is not available now (HTTP {code} {answer.reason}): try again later{self._kept_text()}"
        )

    def _write(self, url: str, answer: Any, have: int, total: int | None) -> None:
        tag = self.tag or _version_tag(answer.headers)
        with wrap_write_errors(self.part):
            self.part.parent.mkdir(parents=True, exist_ok=True)
            # Unbuffered, so that a killed process loses no data; truncated only after the lock is acquired.
            file = self.part.open("ab", buffering=0)
        with file, wrap_write_errors(self.part):
            # Until the process ends, so that no other download writes the partial file.
            if not lock_descriptor(file.fileno(), blocking=False):
                raise DownloadError(f"another download is writing {self.part}: wait until it is done")
            if not have:
                file.truncate(0)
            require_room(self.part.parent, None if total is None else total - have)
            self._identity_file.write_text(f"{url}\n{tag}\n", "utf-8")
            done = have
            self.report(done, total)
            for piece in answer.iter_content(_CHUNK):
                view = memoryview(piece)
                while view:
                    view = view[file.write(view) :]
                done += len(piece)
                self.report(done, total)
        if total is not None and done < total:
            raise _ConnectionBroken("the connection was lost")
        if self.size is not None and done != self.size:
            self.discard()
            raise DownloadError(
                f"{url} was downloaded, but it has {done} bytes instead of {self.size}: "
                f"removed{_append_advice(self.advice)}"
            )


@contextmanager
def wrap_write_errors(path: Path) -> Iterator[None]:
    """Convert an OSError while a file is written to a DownloadError with advice.

    Raises:
        DownloadError: the disk is full, the folder is read-only, or another error of the system.
    """
    import requests

    try:
        yield
    except requests.exceptions.RequestException:  # a subclass of OSError, but not an error of the disk
        raise
    except OSError as error:
        raise write_error(path.parent, error) from error


def write_error(folder: Path, error: OSError) -> DownloadError:
    """Return the DownloadError for a folder that cannot be written."""
    if error.errno in (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)):
        return DownloadError(_no_room(folder))
    return DownloadError(
        f"{folder} cannot be written ({error.strerror}): choose another folder with --to, XDG_CACHE_HOME or HF_HOME"
    )


def require_room(folder: Path, size: int | None) -> None:
    """Raise DownloadError if a disk has less space than ``size`` bytes."""
    if size is not None and shutil.disk_usage(folder).free < size:
        raise DownloadError(_no_room(folder, size))


def _no_room(folder: Path, size: int | None = None) -> str:
    free = format_size(shutil.disk_usage(folder).free) if folder.exists() else "nothing"
    needed = "" if size is None else f", and {format_size(size)} are needed"
    return (
        f"{folder} is full: {free or 'nothing'} free{needed}; free some space, or choose another folder with --to, "
        "XDG_CACHE_HOME or HF_HOME; the partial download is kept, and the next one resumes"
    )


def _continues_at(answer: Any, have: int) -> bool:
    """Return whether a response continues the file at byte ``have``."""
    found = _RANGE.match(answer.headers.get("Content-Range", ""))
    return answer.status_code == 206 and found is not None and int(found[1]) == have


def _total_bytes(answer: Any, have: int) -> int | None:
    length = answer.headers.get("Content-Length", "")
    if answer.headers.get("Content-Encoding", "identity") != "identity" or not length.isdecimal():
        return None
    return int(length) + (have if answer.status_code == 206 else 0)


def _version_tag(headers: Mapping[str, str]) -> str:
    """Return the strong ETag of a response, else its Last-Modified date; "" if it has neither."""
    tag = headers.get("ETag", "")
    return tag if tag and not tag.startswith("W/") else headers.get("Last-Modified", "")


def _describe_connection_error(error: Exception) -> str:
    import requests

    if isinstance(error, requests.exceptions.ConnectTimeout):
        return "the server does not respond"
    if isinstance(error, requests.exceptions.ReadTimeout):
        return "the server has stopped sending"
    if isinstance(error, requests.exceptions.ChunkedEncodingError):
        return "the connection was lost"
    if isinstance(error, requests.exceptions.SSLError):
        return f"no secure connection ({error})"
    if isinstance(error, requests.exceptions.ConnectionError):
        timeout = "Read timed out" in str(error)
        return (
            "the server has stopped sending"
            if timeout
            else "the server cannot be reached: check the network connection"
        )
    return f"{type(error).__name__}: {error}"


def _append_advice(advice: str) -> str:
    return f": {advice}" if advice else ""
