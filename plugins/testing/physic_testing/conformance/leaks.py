"""Settings of the process that a backend should leave alone."""

from __future__ import annotations

import os
import signal
import sys
import warnings
from operator import attrgetter
from signal import SIGINT, SIGTERM
from typing import Any

_SETTINGS = {
    "PIL.Image": ("MAX_IMAGE_PIXELS",),
    "PIL.ImageFile": ("LOAD_TRUNCATED_IMAGES",),
    "cv2": ("getNumThreads()",),
    "logging": ("root.level", "root.manager.disable"),
    "numpy": ("load", "geterr()", "random.get_state()"),
    "os": ("getcwd()",),
    "random": ("getstate()",),
    "sys": ("excepthook",),
    "torch": (
        "load",
        "backends.cudnn.allow_tf32",
        "backends.cudnn.benchmark",
        "backends.cudnn.deterministic",
        "backends.cudnn.enabled",
        "backends.mkldnn.enabled",
        "_C._is_any_autocast_enabled()",
        "are_deterministic_algorithms_enabled()",
        "backends.cuda.flash_sdp_enabled()",
        "backends.cuda.math_sdp_enabled()",
        "get_default_device()",
        "get_default_dtype()",
        "get_float32_matmul_precision()",
        "get_num_threads()",
        "get_rng_state()",
        "is_grad_enabled()",
        "is_inference_mode_enabled()",
    ),
}
"""Module -> attributes and results of functions that are compared."""

_SET_BY_IMPORTS = frozenset(
    {"CUDA_MODULE_LOADING", "LD_LIBRARY_PATH", "TORCHINDUCTOR_CACHE_DIR"}  # torch, OpenCV
    | {"KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK"}  # scikit-learn
)
"""Environment variables that libraries set for themselves when they are imported."""

_VARIABLE = "the environment variable "
_DRAWN_BY_LOAD = "torch.get_rng_state()"


def read_settings() -> dict[str, str]:
    """Return name -> value of the settings of all imported modules, as text."""
    settings = {f"{_VARIABLE}{name}": os.environ[name] for name in {*os.environ} - _SET_BY_IMPORTS}
    settings["warnings.filters"] = str(_broad_filters())
    settings["signal.getsignal()"] = str([signal.getsignal(each) for each in (SIGINT, SIGTERM)])
    for module in _SETTINGS.keys() & sys.modules.keys():
        for name in _SETTINGS[module]:
            value = attrgetter(name.removesuffix("()"))(sys.modules[module])
            value = value() if name.endswith("()") else value
            settings[f"{module}.{name}"] = _text_of(value)
    return settings


def _text_of(value: Any) -> str:
    """Return a value as text; arrays as lists, which are printed in a hundredth of the time."""
    parts = value if isinstance(value, tuple) else (value,)
    return str([one.tolist() if hasattr(one, "tolist") else one for one in parts])


def _broad_filters() -> list[Any]:
    """Return the filters that turn warnings into errors, or are for every warning."""
    return [
        one
        for one in warnings.filters
        if one[0] == "error" or (one[2] is Warning and one[1] is one[3] is None)
    ]


def changed_settings(before: dict[str, str], *, is_load: bool) -> set[str]:
    """Return the names of the settings that differ from those of :func:`read_settings`.

    Args:
        before: their values before a call.
        is_load: whether the call loaded a backend: networks are built with random weights before
            they read their own.
    """
    after = read_settings()
    changed = {name for name, value in before.items() if after.get(name) != value}
    changed |= {name for name in after.keys() - before.keys() if name.startswith(_VARIABLE)}
    return changed - {_DRAWN_BY_LOAD} if is_load else changed
