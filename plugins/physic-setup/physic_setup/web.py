"""Download a file from a web server with pooch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from physic_core.errors import DownloadError

ByteProgress = Callable[[int, int | None], None]
"""Callback with the bytes downloaded so far, and the total if known."""

_CHUNK = 1 << 16  # bytes between two calls of the progress
_CONNECT_S, _READ_S = 20.0, 60.0  # how long a server may not answer, and not send


def download_from_web(url: str, path: Path, size: int | None, report: ByteProgress, advice: str) -> None:
    """Download ``url`` to a file, which is written in place.

    Args:
        url: of the file.
        path: to write to.
        size: of the file, bytes, if the manifest states it: nothing more is downloaded.
        report: called during the download.
        advice: text for the error if the server refuses access or does not have the file.

    Raises:
        DownloadError: the download failed; the message states the cause and what to do.
        OSError: the file cannot be written.
    """
    import pooch
    import requests

    responses: list[requests.Response] = []
    load = pooch.HTTPDownloader(
        progressbar=_SizeCheck(url, size, report),
        chunk_size=_CHUNK,
        timeout=(_CONNECT_S, _READ_S),
        headers={"Accept-Encoding": "identity"},  # so that the stated length is that of the file
        hooks={"response": lambda response, **_: responses.append(response)},
    )
    end = f": {advice}" if advice else ""
    try:
        load(url, str(path), None)
    except requests.HTTPError as error:
        code = responses[-1].status_code
        if code in (401, 403):
            raise DownloadError(f"{url} refuses access (HTTP {code}){end}") from error
        if code in (404, 410):
            raise DownloadError(f"{url} does not exist (HTTP {code}){end}") from error
        raise DownloadError(f"{url} is not available now (HTTP {code}): try again later") from error
    except requests.RequestException as error:
        raise DownloadError(
            f"{url}: the server cannot be reached, or the connection was lost ({type(error).__name__}): check the "
            "network connection, and try again"
        ) from error
    finally:
        for response in responses:  # pooch closes none
            response.close()


class _SizeCheck:
    """What pooch takes as progress bar: reports the bytes so far, and refuses a file of another size."""

    def __init__(self, url: str, size: int | None, report: ByteProgress) -> None:
        self.total = 0  # set by pooch; 0 if the server does not state it
        self._url, self._size, self._report, self._done = url, size, report, 0

    def update(self, count: int) -> None:
        """Count bytes; pooch rounds up to whole chunks."""
        self._done += count
        if self._size is not None and (self.total not in (0, self._size) or self._done >= self._size + _CHUNK):
            raise DownloadError(
                f"{self._url} has {self.total or 'more'} bytes, but the manifest states {self._size}: the file has "
                "changed"
            )
        self._report(min(self._done, self.total or self._done), self.total or None)

    def reset(self) -> None:
        """Begin the last call of pooch, with all bytes."""
        self._done = 0

    def close(self) -> None:
        """End."""
