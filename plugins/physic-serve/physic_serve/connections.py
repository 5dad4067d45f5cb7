"""Connections of the server: those that send no request are closed."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from physic_serve.settings import Limits

__all__ = ["make_server"]


def make_server(app: ASGIApp, host: str, port: int, limits: Limits) -> uvicorn.Server:
    """Return the server of an application; the caller runs it."""

    class Connection(_BoundedConnection):
        head_s, most = limits.head_s, limits.connections

    config = uvicorn.Config(
        app, host, port, http=Connection, ws="none", log_level="warning", timeout_graceful_shutdown=2
    )
    config.load()
    return uvicorn.Server(config)


class _BoundedConnection(H11Protocol):
    """A connection with a time limit until the head of a request is complete; uvicorn has one after a request only.

    Attributes:
        head_s: the time limit, s, from the start of the connection or the end of the last response.
        most: number of connections at which the oldest one without a request is closed.
    """

    head_s: float
    most: int
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        waiting = [one for one in self.connections if isinstance(one, _BoundedConnection) and one._waits()]
        if len(self.connections) > self.most and waiting:
            oldest = min(waiting, key=lambda one: one._deadline())
            self.connections.discard(oldest)
            oldest.transport.abort()
        self._wait()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        if self._timer is not None:
            self._timer.cancel()

    def _wait(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_later(self.head_s, self._close_if_waiting)

    def _waits(self) -> bool:
        """Whether no request is being answered."""
        cycle: Any = self.cycle
        return self._timer is not None and (cycle is None or cycle.response_complete)

    def _deadline(self) -> float:
        return self._timer.when() if self._timer is not None else 0.0

    def _close_if_waiting(self) -> None:
        if self._waits():
            self.transport.close()  # after the rest of the last response; a client that does not read it makes room
