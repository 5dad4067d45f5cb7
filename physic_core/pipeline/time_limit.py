"""Report calls of backends that have a time limit, so that another process can end a call that hangs.

A hang in C code that holds the interpreter lock can only be ended from outside: see :mod:`physic_core.batch.workers`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

CONSTRUCTION = "import and construction of the backends"
"""Title of what happens before a backend is loaded."""

READING = "reading the photo"

_observer: ContextVar[Callable[[str, float], None] | None] = ContextVar("observer", default=None)
_limit: ContextVar[float | None] = ContextVar("limit", default=None)


def report_calls_to(observer: Callable[[str, float], None]) -> None:
    """Report each call of this thread: ``observer(title, seconds)`` at its start, ``observer("", 0)`` at its end."""
    _observer.set(observer)


def is_supervised() -> bool:
    """Return whether another process can end this one, as that of a worker."""
    return _observer.get() is not None


@contextmanager
def limited_calls(seconds: float | None) -> Iterator[None]:
    """Set the time limit of each call in the block, seconds; None for no limit."""
    token = _limit.set(seconds)
    try:
        yield
    finally:
        _limit.reset(token)


@contextmanager
def timed_call(title: str) -> Iterator[None]:
    """Report one call, by the title that an error message of it has."""
    observer, seconds = _observer.get(), _limit.get()
    if observer is None or seconds is None:
        yield
        return
    observer(title, seconds)
    try:
        yield
    finally:
        observer("", 0.0)
