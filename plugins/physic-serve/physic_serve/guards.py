"""What is refused before a request is read: foreign pages, foreign host names, stated lengths, too many requests."""

from __future__ import annotations

import ipaddress
import re
from typing import TYPE_CHECKING

from starlette.requests import Request

from physic_serve.answers import answer

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from physic_serve.settings import Limits

__all__ = ["Guard"]

# A stricter policy would make browsers send forms with the origin "null".
_HEADERS = ((b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"same-origin"))
_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:[0-9]+)?", re.IGNORECASE)
_ORIGIN = re.compile(rf"[a-z][a-z0-9+.-]*://(?P<host>{_HOST.pattern})|null", re.IGNORECASE)


class Guard:
    """Refuse requests that a page of another site sends, foreign host names, large bodies and too many requests.

    A web page can make its reader's browser send requests to 127.0.0.1, and a name server can give 127.0.0.1 a name
    of its owner's choice. It cannot do so with an address, so every address is allowed.

    Args:
        app: gets all other requests. It counts bodies without a stated length.
        hosts: names of this server, in lower case.
        limits: of bodies and connections.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str], limits: Limits) -> None:
        self._app, self._hosts, self._limits = app, hosts, limits
        self._requests = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 400, 403, 413, 421 or 503, or pass the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_unsniffed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        request = Request(scope)
        self._requests += 1
        try:
            if refusal := self._refusal(request):
                # The body is not read, so the connection cannot be used again.
                await answer(request, *refusal, {"Connection": "close"})(scope, receive, send_unsniffed)
            else:
                await self._app(scope, receive, send_unsniffed)
        finally:
            self._requests -= 1

    def _refusal(self, request: Request) -> tuple[int, str] | None:
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if not (named := _HOST.fullmatch(host)):
            return 400, f"the header Host must be a name or an address, and may have a port; got '{host[:80]}'"
        name = named[1].strip("[]").lower()
        if name not in self._hosts and not _is_address(name):
            return 421, f"this server is not called '{name[:80]}': the option --allow-host of physic serve adds a name"
        if origin is not None:
            if not (site := _ORIGIN.fullmatch(origin)):
                return 400, f"the header Origin must be like http://name:port or null; got '{origin[:80]}'"
            if (site["host"] or "").lower() != host.lower():
                return 403, "a page of another site sent this request"
        length = request.headers.get("content-length", "0")
        if length.isdecimal() and int(length) > self._limits.upload_mb * 1e6:
            return 413, "the photo is too large"
        if self._requests > self._limits.connections:
            return 503, "the server has too many requests: try again later"
        return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
