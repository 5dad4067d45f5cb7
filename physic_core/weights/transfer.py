"""Brings a file from a web address, and goes on where an earlier try stopped."""

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
    """The connection ended before the file did."""


class _Changed(Exception):
    """What has come is not the beginning of what would come now."""


@dataclass(frozen=True)
class Transfer:
    """A downloader for :func:`pooch.retrieve` that resumes.

    What has come is kept in a ``.part`` file, and a ``.part.of`` beside it says of which file it is. Where neither a
    hash nor the server's tag could tell that the rest belongs to the same file, it begins anew.

    Attributes:
        part: where the pieces are kept.
        size: how many bytes there have to be, where it is known.
        hashed: whether the whole will be held against a hash afterwards.
        tag: of the file's version, if it is known beforehand.
        headers: sent along.
        advice: what to do where the server refuses, or has no such file.
        tell: told about each piece.
    """

    part: Path
    size: int | None = None
    hashed: bool = False
    tag: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    advice: str = ""
    tell: Tell = lambda done, total: None

    def __call__(self, url: str, output_file: str | os.PathLike[str], pooch: object = None) -> None:
        """Bring all of ``url`` to ``output_file``; pooch's own argument is not needed.

        Raises:
            DownloadError: what stopped it, and what to do; what has come is kept.
        """
        self.bring(url)
        self.place(output_file)

    def bring(self, url: str) -> None:
        """Bring all of ``url`` to the part file.

        Raises:
            DownloadError: what stopped it, and what to do; what has come is kept.
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
        """Move what has come to where it belongs."""
        with writing(Path(output_file)):
            os.replace(self.part, output_file)
            self._of.unlink(missing_ok=True)

    def forget(self) -> None:
        """Drop what has come."""
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
        """One connection."""
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
        """How many bytes are here of what would come now, and the tag that the server gave with them."""
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
    """Say in words what keeps a file from being written.

    Raises:
        DownloadError: the disk is full, the folder may not be written, or what else the system says.
    """
    import requests

    try:
        yield
    except requests.exceptions.RequestException:  # an OSError too, but none of the disk's
        raise
    except OSError as error:
        raise unwritable(path.parent, error) from error


def unwritable(folder: Path, error: OSError) -> DownloadError:
    """What the system says where a folder cannot be written, in words."""
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
    """Two fetches into one file would spoil it; the lock goes with the process, whatever ends that."""
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
    """Whether an answer is the rest of the file from a place on."""
    found = _RANGE.match(answer.headers.get("Content-Range", ""))
    return answer.status_code == 206 and found is not None and int(found[1]) == have


def _total(answer: Any, have: int) -> int | None:
    length = answer.headers.get("Content-Length", "")
    if answer.headers.get("Content-Encoding", "identity") != "identity" or not length.isdecimal():
        return None
    return int(length) + (have if answer.status_code == 206 else 0)


def _strong(headers: Mapping[str, str]) -> str:
    """What a server can be asked by whether a file is still the same."""
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
