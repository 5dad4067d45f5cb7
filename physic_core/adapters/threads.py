"""Limit the CPU threads of torch and of the BLAS of NumPy and SciPy."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["limited_threads"]


@contextmanager
def limited_threads(count: int = 1) -> Iterator[None]:
    """Limit torch and BLAS to ``count`` threads inside the block.

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
