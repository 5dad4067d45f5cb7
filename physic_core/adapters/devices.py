"""Check that a compute device exists."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

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
    found = DEVICE_PATTERN.fullmatch(device)
    if not found:
        raise DeviceError(f"no device named '{device}': use 'cpu', 'cuda' or 'cuda:N'")
    if device == "cpu":
        return
    import torch

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if not count:
        raise DeviceError(
            f"device '{device}' is not there: torch {torch.__version__} finds no CUDA GPU; "
            "use 'cpu', or install a torch build that fits your GPU"
        )
    if int(found.group(1) or 0) >= count:
        last = f"'cuda:0' to 'cuda:{count - 1}' are" if count > 1 else "'cuda:0' is"
        raise DeviceError(f"device '{device}' is not there: only {last}")


def has_gpu() -> bool:
    """Return whether an NVIDIA driver is loaded; faster than importing torch."""
    return shutil.which("nvidia-smi") is not None or any(Path(path).exists() for path in _DRIVER_PATHS)
