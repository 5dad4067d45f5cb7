"""Settings of the process that a backend should leave alone."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from operator import attrgetter
from typing import Any

_VALUES = {
    "PIL.Image": ("MAX_IMAGE_PIXELS",),
    "PIL.ImageFile": ("LOAD_TRUNCATED_IMAGES",),
    "logging": ("root.level", "root.manager.disable"),
    "numpy": ("load",),
    "sys": ("excepthook",),
    "torch": (
        "load",
        "backends.cudnn.allow_tf32",
        "backends.cudnn.benchmark",
        "backends.cudnn.deterministic",
        "backends.cudnn.enabled",
        "backends.mkldnn.enabled",
    ),
}
"""Module -> attributes that are compared."""

_CALLED = {
    "cv2": ("getNumThreads",),
    "numpy": ("geterr",),
    "os": ("getcwd",),
    "torch": (
        "_C._is_any_autocast_enabled",
        "are_deterministic_algorithms_enabled",
        "backends.cuda.flash_sdp_enabled",
        "backends.cuda.math_sdp_enabled",
        "get_default_dtype",
        "get_float32_matmul_precision",
        "get_num_threads",
    ),
}
"""Module -> functions whose results are compared."""

_SET_BY_IMPORTS = frozenset(
    {"CUDA_MODULE_LOADING", "LD_LIBRARY_PATH", "TORCHINDUCTOR_CACHE_DIR"}  # torch, OpenCV
    | {"KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK"}  # scikit-learn
)
"""Environment variables that libraries set for themselves when they are imported."""

_VARIABLE = "the environment variable "
_GENERATOR_OF_TORCH = "torch's random generator"

_STATES: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "handlers of signals": ("signal", lambda m: (m.getsignal(m.SIGINT), m.getsignal(m.SIGTERM))),
    "the generator of `random`": ("random", lambda m: m.getstate()),
    "numpy's random generator": ("numpy.random", lambda m: str(m.get_state(legacy=False)["state"])),
    _GENERATOR_OF_TORCH: ("torch", lambda m: m.get_rng_state().tolist()),
    "torch's modes": (
        "torch",
        lambda m: (
            *(m.is_grad_enabled(), m.is_inference_mode_enabled()),
            m.overrides._get_current_function_mode_stack(),
            m.utils._python_dispatch._get_current_dispatch_mode_stack(),
        ),
    ),
}
"""Name -> module and the state that is compared."""


def read_settings() -> dict[str, Any]:
    """Return name -> value of the settings of all imported modules."""
    found: dict[str, Any] = {"warnings.filters": _broad_filters()}
    for names, is_called in ((_VALUES, False), (_CALLED, True)):
        for library in names.keys() & sys.modules.keys():
            for name in names[library]:
                value = attrgetter(name)(sys.modules[library])
                found[f"{library}.{name}"] = value() if is_called else value
    for name, (library, read) in _STATES.items():
        if library in sys.modules:
            found[name] = read(sys.modules[library])
    variables = os.environ.keys() - _SET_BY_IMPORTS
    return found | {f"{_VARIABLE}{name}": os.environ[name] for name in variables}


def _broad_filters() -> list[Any]:
    """Return the filters that turn warnings into errors, or are for every warning."""
    return [
        one
        for one in warnings.filters
        if one[0] == "error" or (one[2] is Warning and one[1] is one[3] is None)
    ]


def changed_settings(before: dict[str, Any], *, is_load: bool) -> set[str]:
    """Return the names of the settings that differ from those of :func:`read_settings`.

    Args:
        before: their values before a call.
        is_load: whether the call loaded a backend: networks are built with random weights before
            they read their own.
    """
    after = read_settings()
    changed = {name for name, value in before.items() if after.get(name) != value}
    changed |= {name for name in after.keys() - before.keys() if name.startswith(_VARIABLE)}
    return changed - {_GENERATOR_OF_TORCH} if is_load else changed
