"""A viser server that answers only its own page: viser itself asks neither for the host nor for the origin."""

from __future__ import annotations

import base64
import contextlib
import io
import os
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from typing import TYPE_CHECKING, Any

import viser
from websockets.asyncio import server as websockets_server

from physic_core.cli.web_requests import refuse_foreign
from physic_core.errors import BackendError

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request

_ANSWER_S = 10.0  # for the answer of a server in this process


def start_server(host: str, port: int, names: frozenset[str]) -> viser.ViserServer:
    """Start an empty server whose pages and WebSockets refuse what a page of another site can send.

    Args:
        host: address to listen on.
        port: to listen on; the next free one if it is taken.
        names: of the server, in lower case.

    Raises:
        BackendError: the installed viser does not refuse other sites all the same; the server is stopped.
    """
    with contextlib.redirect_stdout(io.StringIO()):  # its banner, which verbose=False leaves
        with _guarded(names):
            server = viser.ViserServer(host=host, port=port, label="PhySIC", verbose=False)
        answer = _answer_to_another_site(local_address(server), server.get_port())
        if answer != "403 Forbidden":
            server.stop()
            raise BackendError(
                f"viser {viser.__version__} did not refuse a page of another site ({answer}), so nothing is shown: "
                "install viser 1.1"
            )
    return server


def local_address(server: viser.ViserServer) -> str:
    """Return the address at which this machine reaches a server."""
    host: str = server.get_host()
    return {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)


@contextlib.contextmanager
def _guarded(names: frozenset[str]) -> Iterator[None]:
    """Let servers of websockets that start meanwhile refuse other sites, since viser passes on no option for it."""
    serve: Any = websockets_server.serve

    def guarded_serve(*args: Any, process_request: Callable[..., Any] | None = None, **options: Any) -> Any:
        def refuse_or_process(connection: ServerConnection, request: Request) -> Any:
            host = ", ".join(request.headers.get_all("Host"))  # two of them are not a name
            origin = ", ".join(request.headers.get_all("Origin")) or None
            if refusal := refuse_foreign(host, origin, names):
                return connection.respond(HTTPStatus(refusal[0]), f"{refusal[1]}\n")
            return process_request(connection, request) if process_request is not None else None

        return serve(*args, process_request=refuse_or_process, **options)

    websockets_server.serve = guarded_serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets_server.serve = serve  # type: ignore[misc]


def _answer_to_another_site(host: str, port: int) -> str:
    """Return what a server answers to a WebSocket of a page of another site, or why it does not answer."""
    headers = {
        "Origin": "http://other-site.invalid",
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(),
    }
    try:
        with contextlib.closing(HTTPConnection(host, port, timeout=_ANSWER_S)) as connection:
            connection.request("GET", "/", headers=headers)
            answer = connection.getresponse()
            return f"{answer.status} {answer.reason}"
    except (OSError, HTTPException) as error:
        return f"{type(error).__name__}: {error}"
