"""Check that a compute device exists, and limit the CPU threads of torch and of the BLAS of NumPy
and SciPy.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from physic_core.errors import DeviceError

DEVICE_PATTERN = re.compile(r"cpu|cuda(?::([0-9]{1,3}))?")
"""Pattern of valid device names: "cpu", "cuda" or "cuda:N"."""

_DRIVER_PATHS = ("/proc/driver/nvidia/version", "/dev/nvidiactl", "/dev/dxg")


def check_device(device: str) -> None:
    """Raise DeviceError if a compute device does not exist.

    Args:
        device: "cpu", "cuda" or "cuda:N".

    Raises:
        DeviceError: unknown kind of device, no GPU, or no GPU of that number.
    """
    match = DEVICE_PATTERN.fullmatch(device)
    if not match:
        raise DeviceError(f"no device named '{device}': use 'cpu', 'cuda' or 'cuda:N'")
    if device == "cpu":
        return
    import torch

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if not count:
        raise DeviceError(
            f"device '{device}' is not available: torch {torch.__version__} finds no CUDA GPU; "
            "use 'cpu', or install a torch build that fits your GPU"
        )
    if int(match.group(1) or 0) >= count:
        last = f"'cuda:0' to 'cuda:{count - 1}' are" if count > 1 else "'cuda:0' is"
        raise DeviceError(f"device '{device}' is not available: only {last}")


def has_gpu() -> bool:
    """Return whether an NVIDIA driver is loaded; faster than importing torch."""
    return shutil.which("nvidia-smi") is not None or any(
        Path(path).exists() for path in _DRIVER_PATHS
    )


@contextmanager
def limited_blas(count: int = 1) -> Iterator[None]:
    """Limit the BLAS of NumPy and SciPy to ``count`` threads inside the block."""
    import scipy.linalg  # noqa: F401 -- threadpoolctl limits the libraries that are loaded
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=count, user_api="blas"):
        yield


@contextmanager
def limited_threads(count: int = 1) -> Iterator[None]:
    """Limit torch and BLAS to ``count`` threads inside the block.

    For tensors of the size of a body, a second thread costs more than it gains. With another busy
    process, two threads made fits up to 45 times slower. torch has its own thread pool, which
    threadpoolctl does not control. If torch is not imported yet, a thread imports it while the
    block runs: this takes more than a second.

    Args:
        count: threads, at least 1.
    """
    before = list[int]()

    def limit_torch() -> None:
        # code that needs torch imports it again, and raises the error
        with suppress(ImportError, OSError):
            import torch

            before.append(torch.get_num_threads())
            torch.set_num_threads(count)

    limiting = Thread(target=limit_torch)
    if "torch" in sys.modules:
        limit_torch()
    else:
        limiting.start()
    try:
        with limited_blas(count):
            yield
    finally:
        if limiting.ident is not None:
            limiting.join()
        if before:
            sys.modules["torch"].set_num_threads(*before)
