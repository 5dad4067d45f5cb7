"""What a checkout may do with torch while it is built: no code but the user's, no objects out of checkpoints."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["guarded_torch"]

_lock = threading.RLock()


@contextmanager
def guarded_torch(hub: Callable[..., Any], *, trusted: bool) -> Iterator[list[Any]]:
    """In this thread, for the block: ``torch.hub.load`` is another function, and ``torch.load`` reads tensors alone.

    Published code fetches somebody's main branch and runs it, or reads whole objects, without asking. Other threads
    are not affected; a second block waits for the first. Yields what ``torch.load`` has read so far.

    Args:
        hub: what is called in place of ``torch.hub.load``.
        trusted: whether checkpoints may hold more than tensors and plain containers.
    """
    import torch

    with _lock:
        here, hub_load, load = threading.get_ident(), torch.hub.load, torch.load

        def own_hub_load(*args: Any, **options: Any) -> Any:
            own: Callable[..., Any] = hub if threading.get_ident() == here else hub_load
            return own(*args, **options)

        read: list[Any] = []

        def own_load(*args: Any, **options: Any) -> Any:
            if threading.get_ident() != here:
                return load(*args, **options)
            read.append(load(*args, **(options if trusted else options | {"weights_only": True})))
            return read[-1]

        torch.hub.load, torch.load = own_hub_load, own_load
        try:
            yield read
        finally:
            torch.hub.load, torch.load = hub_load, load
