"""Connections of the server: clients that send no request or read no response, or hold the most, lose theirs."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import TYPE_CHECKING, Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from physic_serve.settings import Limits


def make_server(app: ASGIApp, host: str, port: int, limits: Limits) -> uvicorn.Server:
    """Return the server of an application; the caller runs it."""

    class Connection(_BoundedConnection):
        bounds = limits

    config = uvicorn.Config(
        app, host, port, http=Connection, ws="none", log_level="warning", timeout_graceful_shutdown=2
    )
    config.load()
    return uvicorn.Server(config)


class _BoundedConnection(H11Protocol):
    """A connection that is closed if its client stalls, or if another client needs its place.

    uvicorn has a time limit after a request only, and none for a client that does not read.

    Attributes:
        bounds: the limits of the server.
    """

    bounds: Limits
    _timer: asyncio.TimerHandle | None = None
    _reading: asyncio.TimerHandle | None = None
    _active = 0.0  # time of the loop at which the client last sent or read something

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        # The whole of it has to be read in head_s, which is the least rate.
        transport.set_write_buffer_limits(high=int(self.bounds.rate_bytes_s * self.bounds.head_s), low=0)
        self._active = self.loop.time()
        self._make_room()
        self._wait()

    def data_received(self, data: bytes) -> None:
        self._active = self.loop.time()
        super().data_received(data)

    def pause_writing(self) -> None:
        super().pause_writing()
        self._reading = self.loop.call_later(self.bounds.head_s, self.transport.abort)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._active = self.loop.time()
        if self._reading is not None:
            self._reading.cancel()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        for timer in (self._timer, self._reading):
            if timer is not None:
                timer.cancel()

    def _make_room(self) -> None:
        """Close the longest idle connection of the client with the most, if there are too many."""
        others = [one for one in self.connections if isinstance(one, _BoundedConnection) and one is not self]
        if len(others) < self.bounds.connections:
            return
        held = Counter(one._address() for one in others)
        last = max(others, key=lambda one: (held[one._address()], -one._active))
        self.connections.discard(last)
        last.transport.abort()

    def _address(self) -> str:
        return self.client[0] if self.client else ""

    def _wait(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_later(self.bounds.head_s, self._close_if_waiting)

    def _close_if_waiting(self) -> None:
        cycle: Any = self.cycle
        if cycle is None or cycle.response_complete:
            self.transport.close()  # after the rest of the last response
