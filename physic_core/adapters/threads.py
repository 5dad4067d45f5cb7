"""How many CPU threads torch and the BLAS of NumPy and SciPy use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["limited_threads"]


@contextmanager
def limited_threads(count: int = 1) -> Iterator[None]:
    """Use ``count`` threads inside the block and restore the earlier numbers after it.

    For tensors of the size of a body, a second thread costs more than it gains. With another busy process, two threads
    made fits up to 45 times slower. torch has its own thread pool, which threadpoolctl does not control.

    Args:
        count: threads, at least 1.
    """
    import torch
    from threadpoolctl import threadpool_limits

    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(limits=count, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(before)
