"""Errors as a page for browsers, and as JSON for programs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from starlette.responses import HTMLResponse, JSONResponse, Response

from physic_serve.pages import error_page

if TYPE_CHECKING:
    from starlette.requests import Request


def wants_page(request: Request) -> bool:
    """Whether a browser shows the response, and not a program."""
    return "text/html" in request.headers.get("accept", "")


def answer(request: Request, status: int, message: str, headers: Mapping[str, str] | None = None) -> Response:
    """Return the response of an error."""
    if wants_page(request):
        return HTMLResponse(error_page(status, message), status, headers)
    return JSONResponse({"detail": message}, status, headers)
