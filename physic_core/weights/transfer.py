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
from typing import IO, Any

from physic_core.errors import DownloadError
from physic_core.weights.locate import size_in_words

__all__ = ["Tell", "Transfer", "unwritable", "writing"]

Tell = Callable[[int, int | None], None]
"""Called with the bytes that are here, and with how many there will be, where that is known."""

_CHUNK = 1 << 16  # what a broken connection may cost of what has come
_CONNECT_SECONDS, _READ_SECONDS = 20.0, 60.0
_TRIES = 5
_RANGE = re.compile(r"bytes (\d+)-")


class _Broken(Exception):
    """The connection ended before the download was complete."""


class _Changed(Exception):
    """The partial download belongs to another version of the remote file."""


@dataclass(frozen=True)
class Transfer:
    """A downloader for :func:`pooch.retrieve` that resumes partial downloads.

    The partial content is kept in a ``.part`` file. A ``.part.of`` file beside it identifies the remote file. If
    neither a hash nor an ETag can prove that both parts belong to the same file, the download starts again.

    Attributes:
        part: path of the partial file.
        size: expected size in bytes, if known.
        hashed: whether a hash of the complete file is verified afterwards.
        tag: ETag of the expected version, if known.
        headers: HTTP headers of the request.
        advice: text for the error if the server refuses the request or does not have the file.
        tell: progress callback: bytes downloaded so far, and the total if known.
    """

    part: Path
    size: int | None = None
    hashed: bool = False
    tag: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    advice: str = ""
    tell: Tell = lambda done, total: None

    def __call__(self, url: str, output_file: str | os.PathLike[str], pooch: object = None) -> None:
        """Download ``url`` to ``output_file``; the argument ``pooch`` is ignored.

        Raises:
            DownloadError: the download failed; the partial file is kept.
        """
        self.bring(url)
        self.place(output_file)

    def bring(self, url: str) -> None:
        """Download ``url`` to the partial file.

        Raises:
            DownloadError: the download failed; the partial file is kept.
        """
        tries, anew = 0, False
        while True:
            before = self._here()
            try:
                self._continue(url)
                return
            except _Changed as error:
                self.forget()
                if anew:
                    raise DownloadError(f"{url} changes while it is fetched: try again later") from error
                anew = True
            except _Broken as error:
                tries += 1
                if self._here() <= before or tries == _TRIES:
                    raise DownloadError(f"{url}: {error}{self._kept()}") from error
                time.sleep(1.0)  # a router that restarts, a server that moves on

    def place(self, output_file: str | os.PathLike[str]) -> None:
        """Move the complete download to ``output_file``."""
        with writing(Path(output_file)):
            os.replace(self.part, output_file)
            self._of.unlink(missing_ok=True)

    def forget(self) -> None:
        """Delete the partial file."""
        with writing(self.part):
            self.part.unlink(missing_ok=True)
            self._of.unlink(missing_ok=True)

    @property
    def _of(self) -> Path:
        return self.part.with_name(self.part.name + ".of")

    def _here(self) -> int:
        return self.part.stat().st_size if self.part.is_file() else 0

    def _kept(self) -> str:
        here = self._here()
        return f"; {size_in_words(here)} of it are kept, and the next fetch goes on from there" if here else ""

    def _continue(self, url: str) -> None:
        """Download over one connection."""
        import requests

        have, validator = self._resumable(url)
        if self.size is not None and have == self.size:
            self.tell(have, self.size)
            return
        headers = {"Accept-Encoding": "identity", **self.headers}
        if have:
            headers["Range"] = f"bytes={have}-"
            if validator:
                headers["If-Range"] = validator
        try:
            with requests.get(url, headers=headers, stream=True, timeout=(_CONNECT_SECONDS, _READ_SECONDS)) as answer:
                if have and answer.status_code == 416 and answer.headers.get("Content-Range", "") == f"bytes */{have}":
                    return  # there is no rest: it was all here
                if have and (answer.status_code == 416 or (answer.status_code == 206 and not _goes_on(answer, have))):
                    raise _Changed
                if answer.status_code == 200:
                    have = 0
                self._require_answer(url, answer)
                total = _total(answer, have)
                if self.size is not None and total not in (None, self.size):
                    raise DownloadError(
                        f"{url} has {total} bytes, and the list of weights says {self.size}: it is another file by now"
                        f"{_then(self.advice)}"
                    )
                self._write(url, answer, have, total if total is not None else self.size)
        except requests.exceptions.RequestException as error:
            raise _Broken(_in_words(error)) from error

    def _resumable(self, url: str) -> tuple[int, str]:
        """Bytes of the partial file that can be kept, and the ETag stored with them."""
        have = self._here()
        if not have:
            return 0, ""
        lines = self._of.read_text("utf-8").splitlines() if self._of.is_file() else []
        source, tag = [*lines, "", ""][:2]
        same = source == url and (not self.tag or tag == self.tag) and (self.size is None or have <= self.size)
        if not same or not (self.hashed or tag):
            return 0, ""
        return have, "" if self.tag else tag

    def _require_answer(self, url: str, answer: Any) -> None:
        code = answer.status_code
        if code in (200, 206):
            return
        if code in (401, 403, 407):
            raise DownloadError(f"{url} is not given to everybody (HTTP {code}){_then(self.advice)}")
        if code in (404, 410):
            raise DownloadError(f"{url} is not there (HTTP {code}){_then(self.advice)}")
        raise DownloadError(f"{url} cannot be had now (HTTP {code} {answer.reason}): try again later{self._kept()}")

    def _write(self, url: str, answer: Any, have: int, total: int | None) -> None:
        tag = self.tag or _strong(answer.headers)
        with writing(self.part):
            self.part.parent.mkdir(parents=True, exist_ok=True)
            # Unbuffered, so that what has come is on the disk whatever ends us; not emptied before it is ours.
            file = self.part.open("ab", buffering=0)
        with file, writing(self.part):
            _lock(file, self.part)
            if not have:
                file.truncate(0)
            _require_room(self.part.parent, None if total is None else total - have)
            self._of.write_text(f"{url}\n{tag}\n", "utf-8")
            done = have
            self.tell(done, total)
            for piece in answer.iter_content(_CHUNK):
                view = memoryview(piece)
                while view:
                    view = view[file.write(view) :]
                done += len(piece)
                self.tell(done, total)
        if total is not None and done < total:
            raise _Broken("the connection broke")
        if self.size is not None and done != self.size:
            self.forget()
            raise DownloadError(
                f"{url} came, but it has {done} bytes instead of {self.size}: removed{_then(self.advice)}"
            )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Convert an OSError while writing to a DownloadError with an explanation.

    Raises:
        DownloadError: the disk is full, the folder is read-only, or another error of the system.
    """
    import requests

    try:
        yield
    except requests.exceptions.RequestException:  # an OSError too, but none of the disk's
        raise
    except OSError as error:
        raise unwritable(path.parent, error) from error


def unwritable(folder: Path, error: OSError) -> DownloadError:
    """Build the error for a folder that cannot be written."""
    if error.errno in (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)):
        return DownloadError(_no_room(folder))
    return DownloadError(
        f"{folder} cannot be written ({error.strerror}): name another folder by --to, XDG_CACHE_HOME or HF_HOME"
    )


def _require_room(folder: Path, size: int | None) -> None:
    if size is not None and shutil.disk_usage(folder).free < size:
        raise DownloadError(_no_room(folder, size))


def _no_room(folder: Path, size: int | None = None) -> str:
    free = size_in_words(shutil.disk_usage(folder).free) if folder.exists() else "nothing"
    needed = "" if size is None else f", and {size_in_words(size)} are needed"
    return (
        f"no room in {folder}: {free or 'nothing'} free{needed}; make room, or name another folder by --to, "
        "XDG_CACHE_HOME or HF_HOME; what has come is kept, and the next fetch goes on from there"
    )


def _lock(file: IO[bytes], part: Path) -> None:
    """Lock the partial file, so that two downloads cannot write it; the lock ends with the process."""
    try:
        import fcntl
    except ImportError:  # Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise DownloadError(f"another fetch is writing {part}: wait for it") from error
    except OSError:  # a file system without locks
        return


def _goes_on(answer: Any, have: int) -> bool:
    """Whether a response continues the file at byte ``have``."""
    found = _RANGE.match(answer.headers.get("Content-Range", ""))
    return answer.status_code == 206 and found is not None and int(found[1]) == have


def _total(answer: Any, have: int) -> int | None:
    length = answer.headers.get("Content-Length", "")
    if answer.headers.get("Content-Encoding", "identity") != "identity" or not length.isdecimal():
        return None
    return int(length) + (have if answer.status_code == 206 else 0)


def _strong(headers: Mapping[str, str]) -> str:
    """The strong ETag of a response, else its Last-Modified date; "" if it has neither."""
    tag = headers.get("ETag", "")
    return tag if tag and not tag.startswith("W/") else headers.get("Last-Modified", "")


def _in_words(error: Exception) -> str:
    import requests

    if isinstance(error, requests.exceptions.ConnectTimeout):
        return "the server does not answer"
    if isinstance(error, requests.exceptions.ReadTimeout):
        return "the server has stopped sending"
    if isinstance(error, requests.exceptions.ChunkedEncodingError):
        return "the connection broke"
    if isinstance(error, requests.exceptions.SSLError):
        return f"no safe connection ({error})"
    if isinstance(error, requests.exceptions.ConnectionError):
        timeout = "Read timed out" in str(error)
        return "the server has stopped sending" if timeout else "the server cannot be reached: is the network on?"
    return f"{type(error).__name__}: {error}"


def _then(advice: str) -> str:
    return f": {advice}" if advice else ""
