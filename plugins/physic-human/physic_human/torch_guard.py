"""Restrict torch while a checkout builds its network: no downloaded code, and no pickled objects."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_lock = threading.RLock()


@contextmanager
def guarded_torch(hub: Callable[..., Any], *, trusted: bool) -> Iterator[list[Any]]:
    """Replace ``torch.hub.load`` and let ``torch.load`` read only tensors, in this thread and inside the block.

    Published code downloads and runs main branches, or unpickles objects. Other threads are not affected; a second
    block waits for the first. Yields what ``torch.load`` has read so far.

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
