"""What is refused before a request is read: foreign pages, foreign host names, stated lengths."""

from __future__ import annotations

import ipaddress
import re
from typing import TYPE_CHECKING

from starlette.requests import Request

from physic_serve.answers import answer

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from physic_serve.settings import Limits

_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:[0-9]+)?", re.IGNORECASE)
_ORIGIN = re.compile(rf"[a-z][a-z0-9+.-]*://(?P<host>{_HOST.pattern})|null", re.IGNORECASE)

# A stricter policy would make browsers send forms with the origin "null".
_HEADERS = ((b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"same-origin"))


class Guard:
    """Refuse requests that a page of another site sends, foreign host names and large bodies.

    Args:
        app: gets all other requests. It counts bodies without a stated length.
        hosts: names of this server, in lower case.
        limits: of bodies.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str], limits: Limits) -> None:
        self._app, self._hosts, self._limits = app, hosts, limits

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 400, 403, 413 or 421, or pass the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_unsniffed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        request = Request(scope)
        if refusal := self._refusal(request):
            # The body is not read, so the connection cannot be used again.
            await answer(request, *refusal, {"Connection": "close"})(scope, receive, send_unsniffed)
        else:
            await self._app(scope, receive, send_unsniffed)

    def _refusal(self, request: Request) -> tuple[int, str] | None:
        headers = request.headers
        if refusal := _refuse_foreign(headers.get("host", ""), headers.get("origin"), self._hosts):
            return refusal
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > self._limits.upload_mb * 1e6:
            return 413, "the photo is too large"
        return None


def _refuse_foreign(host: str, origin: str | None, names: frozenset[str]) -> tuple[int, str] | None:
    """Return why to refuse a request, which a page of another site could have sent; None to accept it.

    A web page can make its reader's browser send requests to 127.0.0.1, and a name server can give 127.0.0.1 a name
    of its owner's choice. It cannot do so with an address, so every address is allowed.

    Args:
        host: value of the header Host, or "" without one.
        origin: value of the header Origin, or None without one.
        names: of the server, in lower case.

    Returns:
        The status of HTTP, 400, 403 or 421, and the words of the refusal.
    """
    if not (named := _HOST.fullmatch(host)):
        return 400, f"the header Host must be a name or an address, and may have a port; got '{host[:80]}'"
    name = named[1].strip("[]").lower()
    if name not in names and not _is_address(name):
        return 421, f"this server is not called '{name[:80]}': the option --allow-host adds a name"
    if origin is not None:
        if not (site := _ORIGIN.fullmatch(origin)):
            return 400, f"the header Origin must be like http://name:port or null; got '{origin[:80]}'"
        if (site["host"] or "").lower() != host.lower():
            return 403, "a page of another site sent this request"
    return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
