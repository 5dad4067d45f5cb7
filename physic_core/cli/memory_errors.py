"""Errors that mean that the process got no more memory, by Python, NumPy, torch or the loader of libraries."""

from __future__ import annotations

import errno

__all__ = ["is_out_of_memory"]

_TEXTS = ("failed to map segment", "cannot allocate memory", "can't allocate memory", "out of memory")


def is_out_of_memory(error: BaseException) -> bool:
    """Return whether an error, or one that it was raised from, is for lack of memory."""
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, MemoryError) or (isinstance(seen, OSError) and seen.errno == errno.ENOMEM):
            return True
        if isinstance(seen, (ImportError, RuntimeError)) and any(text in str(seen).lower() for text in _TEXTS):
            return True
        seen = seen.__cause__
    return False
