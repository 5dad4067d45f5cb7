"""Reject cross-site requests to commands that serve a page in the browser."""

from __future__ import annotations

import ipaddress
import re

_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(:[0-9]+)?", re.IGNORECASE)
_ORIGIN = re.compile(rf"[a-z][a-z0-9+.-]*://(?P<host>{_HOST.pattern})|null", re.IGNORECASE)


def refuse_foreign(host: str, origin: str | None, names: frozenset[str]) -> tuple[int, str] | None:
    """Return why to reject a request that a page of another site could have sent; None to accept it.

    A web page can make its reader's browser send requests to 127.0.0.1, and a name server can give 127.0.0.1 any name
    that its owner chooses. It cannot do so with an address, so every address is allowed.

    Args:
        host: value of the Host header, or "" without one.
        origin: value of the Origin header, or None without one.
        names: of the server, in lower case.

    Returns:
        The HTTP status, 400, 403 or 421, and the message.
    """
    if not (named := _HOST.fullmatch(host)):
        return 400, f"the Host header must be a name or an address, optionally with a port; got '{host[:80]}'"
    name = named[1].strip("[]").lower()
    if name not in names and not _is_address(name):
        return 421, f"this server is not called '{name[:80]}': the option --allow-host adds a name"
    if origin is not None:
        if not (site := _ORIGIN.fullmatch(origin)):
            return 400, f"the Origin header must be like http://name:port, or null; got '{origin[:80]}'"
        if (site["host"] or "").lower() != host.lower():
            return 403, "this request came from a page of another site"
    return None


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
