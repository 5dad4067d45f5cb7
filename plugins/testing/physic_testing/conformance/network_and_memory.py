"""Network block and memory measurement for checks of constructors."""

from __future__ import annotations

import ctypes
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch


@contextmanager
def no_network() -> Iterator[list[str]]:
    """Block Python's sockets in this block; yield the list of addresses that were requested."""
    requested: list[str] = []

    def refuse(place: object) -> None:
        requested.append(_in_words(place))
        raise OSError(f"network access is blocked in this check: {_in_words(place)} was requested")

    def connect(self: socket.socket, address: Any) -> None:
        refuse(address)

    def look_up(host: Any, *arguments: Any, **options: Any) -> None:
        refuse(host)

    with (
        patch.object(socket.socket, "connect", connect),
        patch.object(socket.socket, "connect_ex", connect),
        patch.object(socket.socket, "bind", connect),
        patch.object(socket, "getaddrinfo", look_up),
        patch.object(socket, "gethostbyname", look_up),
    ):
        yield requested


def resident_megabytes() -> float:
    """Return the resident memory in use by this process without files in MB; 0 if the system does
    not report it.

    Two things would hide memory that a backend takes. The system drops pages of files at any time,
    such as of libraries. The C library keeps freed memory resident and hands it out again; glibc
    can return it.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        return 0.0
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):
        libc.malloc_trim(0)
    lines = status.read_text().splitlines()
    return (
        sum(
            int(line.split()[1]) * 1024
            for line in lines
            if line.startswith(("RssAnon:", "RssShmem:"))
        )
        / 1e6
    )


def _in_words(place: object) -> str:
    """Format a network address as text."""
    return ":".join(map(str, place)) if isinstance(place, tuple) else str(place)
