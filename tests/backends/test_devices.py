"""Threads of torch and BLAS."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info

from physic_core.backends.devices import limited_threads


def blas_threads():
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.parametrize("count", [1, 2])
def test_threads_are_limited_inside_and_restored_after(count):
    np.linalg.inv(np.eye(3))
    torch_before = torch.get_num_threads()
    blas_before = blas_threads()
    assert blas_before
    with limited_threads(count):
        assert torch.get_num_threads() == count
        assert max(blas_threads()) <= count
    assert (torch.get_num_threads(), blas_threads()) == (torch_before, blas_before)


def test_torch_is_imported_beside_the_block_and_limited(python):
    code = """
import sys, threading
from physic_core.backends.devices import limited_threads
with limited_threads(1):
    for thread in set(threading.enumerate()) - {threading.main_thread()}:
        thread.join()
    print(sys.modules["torch"].get_num_threads())
"""
    assert python(code).stdout == "1\n"
