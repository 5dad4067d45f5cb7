"""Keep messages that a C library prints out of the terminal."""

from __future__ import annotations

import logging
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["log_native_messages"]

_LOG = logging.getLogger(__name__)
_STDERR = 2
_REDIRECTED = threading.RLock()


@contextmanager
def log_native_messages() -> Iterator[None]:
    """Log at level DEBUG what is written to file descriptor 2, instead of showing it.

    C libraries such as libtiff print there, and Python cannot stop them. Meanwhile, messages of other threads are
    logged too: use it for short calls.
    """
    with _REDIRECTED, tempfile.TemporaryFile() as found:
        try:
            if sys.stderr is not None:
                sys.stderr.flush()
            terminal = os.dup(_STDERR)
        except (OSError, ValueError):  # a process without a terminal: nothing can be shown
            yield
            return
        try:
            os.dup2(found.fileno(), _STDERR)
            yield
        finally:
            os.dup2(terminal, _STDERR)
            os.close(terminal)
            found.seek(0)
            if text := found.read(10_000).decode("utf-8", "replace"):
                _LOG.debug("%s", ascii(text.strip()))
