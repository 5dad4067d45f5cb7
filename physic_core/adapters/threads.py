"""Limit the CPU threads of torch and of the BLAS of NumPy and SciPy."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Thread


@contextmanager
def limited_threads(count: int = 1) -> Iterator[None]:
    """Limit torch and BLAS to ``count`` threads inside the block.

    For tensors of the size of a body, a second thread costs more than it gains. With another busy process, two threads
    made fits up to 45 times slower. torch has its own thread pool, which threadpoolctl does not control. If torch is
    not imported yet, a thread imports it while the block runs: this takes more than a second.

    Args:
        count: threads, at least 1.
    """
    import scipy.linalg  # noqa: F401 -- threadpoolctl limits the libraries that are loaded
    from threadpoolctl import threadpool_limits

    before = list[int]()

    def limit_torch() -> None:
        with suppress(ImportError, OSError):  # whatever needs torch imports it again, and fails
            import torch

            before.append(torch.get_num_threads())
            torch.set_num_threads(count)

    limiting = Thread(target=limit_torch, name="import torch")
    if "torch" in sys.modules:
        limit_torch()
    else:
        limiting.start()
    try:
        with threadpool_limits(limits=count, user_api="blas"):
            yield
    finally:
        if limiting.ident is not None:
            limiting.join()
        if before:
            sys.modules["torch"].set_num_threads(*before)
