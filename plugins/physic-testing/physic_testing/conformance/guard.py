"""Watches what a backend does to the machine: network and memory."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

__all__ = ["no_network", "resident_megabytes"]


@contextmanager
def no_network() -> Iterator[list[str]]:
    """Nothing in this block reaches a network through Python's sockets; yields the places that were asked for."""
    asked: list[str] = []

    def refuse(place: object) -> None:
        asked.append(_in_words(place))
        raise OSError(f"the network is not to be used here: {_in_words(place)} was asked for")

    def connect(self: socket.socket, address: Any) -> None:
        refuse(address)

    def look_up(host: Any, *arguments: Any, **options: Any) -> None:
        refuse(host)

    with (
        patch.object(socket.socket, "connect", connect),
        patch.object(socket.socket, "connect_ex", connect),
        patch.object(socket, "getaddrinfo", look_up),
        patch.object(socket, "gethostbyname", look_up),
    ):
        yield asked


def resident_megabytes() -> float:
    """Memory of this process; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    import resource

    return pages * resource.getpagesize() / 1e6


def _in_words(place: object) -> str:
    return ":".join(map(str, place)) if isinstance(place, tuple) else str(place)
