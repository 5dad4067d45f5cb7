"""What is refused before a request is read: foreign pages, foreign host names, stated lengths."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

from starlette.requests import Request
from starlette.responses import PlainTextResponse

from physic_serve.answers import answer

__all__ = ["SameOrigin", "StatedLength"]


# A stricter policy would make browsers send forms with the origin "null".
_HEADERS = ((b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"same-origin"))


class SameOrigin:
    """Refuse requests that a page of another site sends, and host names that are not this server's.

    A web page can make its reader's browser send requests to 127.0.0.1, and a name server can give 127.0.0.1 a name
    of its owner's choice.

    Args:
        app: gets all other requests.
        hosts: names of this server; None allows every name, for a server that others reach.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str] | None) -> None:
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 400 or 403, or pass the request on."""
        if scope["type"] == "http":
            headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
            host, origin = headers.get("host", ""), headers.get("origin")
            if self._hosts is not None and urlsplit(f"//{host}").hostname not in self._hosts:
                await PlainTextResponse("this server has another name\n", 400)(scope, receive, send)
                return
            if origin is not None and urlsplit(origin).netloc != host:
                await PlainTextResponse("a page of another site sent this request\n", 403)(scope, receive, send)
                return

        async def send_unsniffed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        await self._app(scope, receive, send_unsniffed)


class StatedLength:
    """Refuse a body whose stated length is over ``limit`` bytes; those without a length are counted by FastAPI."""

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app, self._limit = app, limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer 413, or pass the request on."""
        stated = dict(scope.get("headers", ())).get(b"content-length", b"0")
        if scope["type"] == "http" and stated.isdigit() and int(stated) > self._limit:
            # The body is not read, so the connection cannot be used again.
            refusal = answer(Request(scope), 413, "the photo is too large", {"Connection": "close"})
            await refusal(scope, receive, send)
            return
        await self._app(scope, receive, send)
