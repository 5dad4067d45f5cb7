"""What is refused before a request is read: foreign pages, foreign host names, stated lengths."""

from __future__ import annotations

from typing import TYPE_CHECKING

from starlette.requests import Request

from physic_core.cli.web_requests import refuse_foreign
from physic_serve.answers import answer

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

    from physic_serve.settings import Limits

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
        if refusal := refuse_foreign(headers.get("host", ""), headers.get("origin"), self._hosts):
            return refusal
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > self._limits.upload_mb * 1e6:
            return 413, "the photo is too large"
        return None
