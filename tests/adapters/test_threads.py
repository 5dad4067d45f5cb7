"""CPU threads of torch and BLAS."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info

from physic_core.adapters.threads import limited_threads


def blas_threads() -> list[int]:
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


@pytest.mark.parametrize("count", [1, 2])
def test_threads_are_limited_inside_and_restored_after(count: int) -> None:
    np.linalg.inv(np.eye(3))
    torch_before, blas_before = torch.get_num_threads(), blas_threads()
    assert blas_before
    with limited_threads(count):
        assert torch.get_num_threads() == count
        assert max(blas_threads()) <= count
    assert (torch.get_num_threads(), blas_threads()) == (torch_before, blas_before)


def test_torch_is_imported_beside_the_block_and_limited() -> None:
    code = """
import sys, threading
from physic_core.adapters.threads import limited_threads
with limited_threads(1):
    for thread in set(threading.enumerate()) - {threading.main_thread()}:
        thread.join()
    print(sys.modules["torch"].get_num_threads())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n", done.stderr


def test_a_run_imports_torch_in_another_thread_while_the_first_network_runs() -> None:
    code = """
import sys, threading
importers = []

class Watch:
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            importers.append(threading.current_thread() is threading.main_thread())

sys.meta_path.insert(0, Watch())
import numpy as np
from physic_core import reconstruct
from physic_core.errors import NoPersonError

try:
    reconstruct(np.zeros((64, 64, 3), np.uint8), {"extends": "embedded", "photo": {"require_people": True}})
except NoPersonError:
    print(importers)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[False]\n", done.stderr
