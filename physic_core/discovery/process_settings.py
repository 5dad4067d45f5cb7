"""The settings of a process that change numbers or raise: of Python, numpy, OpenCV, Pillow and
torch.

Listed is what code of networks is known to change. Not listed is what only shows on a screen, and
what importing a library may change: search paths, handlers of logs, filters for warnings of one
kind.
"""

from __future__ import annotations

import ctypes

# Rows below name these modules.
import logging  # noqa: F401
import operator
import os  # noqa: F401
import random  # noqa: F401
import threading
import warnings  # noqa: F401
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

IMPORTED = frozenset(
    # torch, OpenCV, Ray
    {"CUDA_MODULE_LOADING", "LD_LIBRARY_PATH", "RAY_CLIENT_MODE", "TORCHINDUCTOR_CACHE_DIR"}
    | {"KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK"}  # scikit-learn
)
"""Environment variables that libraries set for themselves when they are imported or begin."""

LIMITING = "import torch"
"""Name of the thread that imports torch, and then limits its threads."""

_SHOWN = 40  # characters of a value in a message
_HALF_STEP = 2.0**-54


@dataclass(frozen=True)
class Setting:
    """A setting of the process.

    Attributes:
        name: in messages.
        library: module that must be imported for it to exist.
        read: returns its value, given the module.
        write: sets it, given the module and a value of ``read``.
        fresh: returns its value right after the module's import, given the module; None if it
            cannot be known.
        quiet_in_load: whether ``load`` may change it: it is restored without a report.
        same: whether two values mean the same.
        describe: text of a change, given both values; "" for the name alone.
    """

    name: str
    library: str
    read: Callable[[Any], Any]
    write: Callable[[Any, Any], object]
    fresh: Callable[[Any], Any] | None = None
    quiet_in_load: bool = False
    same: Callable[[Any, Any], bool] = operator.eq
    describe: Callable[[Any, Any], str] = lambda before, after: _arrow(before, after)


def _arrow(before: Any, after: Any) -> str:
    texts = [str(value) for value in (before, after)]
    return " -> ".join(texts) if max(map(len, texts)) <= _SHOWN else ""


def _no_text(before: Any, after: Any) -> str:
    return ""


def _attribute(
    name: str, library: str, attribute: str, fresh: Callable[[Any], Any] | None = None
) -> Setting:
    """Return the setting that is an attribute of a module."""
    return Setting(
        name,
        library,
        operator.attrgetter(attribute),
        lambda module, value: setattr(module, attribute, value),
        fresh,
    )


def _always(value: Any) -> Callable[[Any], Any]:
    return lambda _: value


# ---- the interpreter
# -------------------------------------------------------------------------------------------------


def _read_environment(module: Any) -> dict[str, str]:
    return {name: value for name, value in module.environ.items() if name not in IMPORTED}


def _write_environment(module: Any, before: dict[str, str]) -> None:
    for name in _read_environment(module).keys() - before.keys():
        del module.environ[name]
    module.environ.update(before)


def _harmful_filters(earlier: list[Any], later: list[Any]) -> list[Any]:
    """Return the filters that were added and turn warnings into errors, or are for every
    warning.
    """
    added = [one for one in later if one not in earlier]
    return [
        one
        for one in added
        if one[0] == "error" or (one[1] is one[3] is None and one[2] is Warning)
    ]


def _same_filters(earlier: list[Any], later: list[Any]) -> bool:
    if earlier == later:
        return True
    return all(one in later for one in earlier) and not _harmful_filters(earlier, later)


def _write_filters(module: Any, before: list[Any]) -> None:
    later = list(module.filters)
    harmful = _harmful_filters(before, later)
    added = [one for one in later if one not in before and one not in harmful]
    module.filters[:] = [*added, *before]
    with module.catch_warnings():  # its end makes Python forget which warnings it has shown
        pass


@cache
def _c_library() -> Any:
    return ctypes.CDLL(None)  # raises TypeError on Windows


def _read_float_rules(module: Any) -> tuple[tuple[str, ...], Any]:
    """Return numbers that show rounding and flushing of subnormal numbers, and C's ``fenv_t`` of
    this thread.
    """
    smallest = module.float_info.min
    one = float("1")
    saved = ctypes.create_string_buffer(256)
    _c_library().fegetenv(saved)
    probes = (smallest / 2, one + _HALF_STEP, -one - _HALF_STEP, one - _HALF_STEP / 2)
    # as texts: where subnormal numbers count as zero, they equal it
    return tuple(map(float.hex, probes)), saved


def _changed_names(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Return the names whose values differ, without the values: those of variables may be
    secret.
    """
    return ", ".join(
        sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    )


_INTERPRETER = (
    Setting(
        "the current folder", "os", lambda os_: os_.getcwd(), lambda os_, value: os_.chdir(value)
    ),
    Setting(
        "the environment", "os", _read_environment, _write_environment, describe=_changed_names
    ),
    Setting(
        "warning filters", "warnings", lambda m: list(m.filters), _write_filters, same=_same_filters
    ),
    Setting(
        "the level of logs",
        "logging",
        lambda m: (m.root.level, m.root.manager.disable),
        lambda m, value: (m.root.setLevel(value[0]), m.disable(value[1])),
    ),
    Setting(
        "rounding of floats",
        "sys",
        _read_float_rules,
        lambda m, value: _c_library().fesetenv(value[1]),
        same=lambda earlier, later: bool(earlier[0] == later[0]),
        describe=_no_text,
    ),
    Setting(
        "the generator of `random`",
        "random",
        lambda m: m.getstate(),
        lambda m, v: m.setstate(v),
        describe=_no_text,
    ),
)


# ---- numpy, SciPy, OpenCV, Pillow
# ------------------------------------------------------------------------------------


def _read_numpy_generator(module: Any) -> tuple[Any, ...]:
    """Return what shows a change, and the generator and its state."""
    generator = module.get_bit_generator()
    state = module.get_state(legacy=False)
    values = [
        value.tobytes() if hasattr(value, "tobytes") else value for value in state["state"].values()
    ]
    return (id(generator), values, state["has_gauss"], state["gauss"]), generator, state


def _write_numpy_generator(module: Any, value: tuple[Any, ...]) -> None:
    _, generator, state = value
    module.set_bit_generator(generator)
    module.set_state(state)


def _default_opencv_threads(cv2: Any) -> int:
    current = cv2.getNumThreads()
    cv2.setNumThreads(-1)
    default: int = cv2.getNumThreads()
    cv2.setNumThreads(current)
    return default


_NUMERIC = (
    Setting(
        "numpy's treatment of errors",
        "numpy",
        lambda m: (m.geterr(), m.geterrcall()),
        lambda m, value: (m.seterr(**value[0]), m.seterrcall(value[1])),
        fresh=_always(
            ({"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}, None)
        ),
    ),
    Setting(
        "numpy's random generator",
        "numpy.random",
        _read_numpy_generator,
        _write_numpy_generator,
        same=lambda earlier, later: bool(earlier[0] == later[0]),
        describe=_no_text,
    ),
    _attribute("numpy.load", "numpy", "load"),
    Setting(
        "OpenCV's threads",
        "cv2",
        lambda m: m.getNumThreads(),
        lambda m, value: m.setNumThreads(value),
        fresh=_default_opencv_threads,
    ),
    _attribute("Pillow's limit of pixels", "PIL.Image", "MAX_IMAGE_PIXELS"),
    _attribute(
        "Pillow's treatment of truncated files",
        "PIL.ImageFile",
        "LOAD_TRUNCATED_IMAGES",
        fresh=_always(False),
    ),
)


# ---- torch
# --------------------------------------------------------------------------------------------------

_PRECISIONS = tuple(
    f"{name}.fp32_precision"
    for name in (
        *(
            "backends",
            "backends.mkldnn",
            "backends.mkldnn.matmul",
            "backends.mkldnn.conv",
            "backends.mkldnn.rnn",
        ),
        *("backends.cudnn", "backends.cudnn.conv", "backends.cudnn.rnn", "backends.cuda.matmul"),
    )
)
_SDP = ("flash", "mem_efficient", "math", "cudnn")
_GUARDS = list[Any]()  # a guard of torch ends when it is collected


def _read_attributes(torch: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the values of those of the attributes that this torch has."""
    values = {}
    for name in names:
        try:
            values[name] = operator.attrgetter(name)(torch)
        except (AttributeError, RuntimeError):  # of another torch, or contradicting another one
            continue
    return values


def _write_attributes(torch: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        owner, _, attribute = name.rpartition(".")
        setattr(operator.attrgetter(owner)(torch), attribute, value)


def _write_inference_mode(torch: Any, value: bool) -> None:
    guard = torch.inference_mode(value)
    guard.__enter__()
    _GUARDS.append(guard)


def _write_default_device(torch: Any, value: str) -> None:
    torch.set_default_device(None if value == "cpu" else value)  # "cpu" would slow later calls
    if str(torch.get_default_device()) != value:  # a context was entered and not left
        guard = torch.device(value)
        guard.__enter__()
        _GUARDS.append(guard)


def _write_autocast(torch: Any, value: tuple[Any, ...]) -> None:
    for device, (on, dtype) in zip(_AUTOCAST, value, strict=True):
        torch.set_autocast_enabled(device, on)
        torch.set_autocast_dtype(device, dtype)


def _read_threads(torch: Any) -> int:
    # A thread that limits them has imported torch, and has yet to say its number.
    for thread in threading.enumerate():
        if thread.name == LIMITING:
            thread.join()
    count: int = torch.get_num_threads()
    return count


def _of_gpu(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return the function ``read`` of ``torch.cuda``, which raises RuntimeError if no GPU is in
    use: most functions of that module would start one.
    """

    def read_in_use(torch: Any) -> Any:
        if not torch.cuda.is_initialized():
            raise RuntimeError("no GPU is in use")
        return read(torch.cuda)

    return read_in_use


def _read_gpu_generators(cuda: Any) -> list[bytes]:
    return [state.numpy().tobytes() for state in cuda.get_rng_state_all()]


_AUTOCAST = ("cpu", "cuda")
_TORCH = (
    Setting(
        "torch's inference mode",
        "torch",
        lambda m: m.is_inference_mode_enabled(),
        _write_inference_mode,
        fresh=_always(False),
    ),
    Setting(
        "torch's gradient mode",
        "torch",
        lambda m: m.is_grad_enabled(),
        lambda m, value: m.set_grad_enabled(value),
        fresh=_always(True),
    ),
    Setting(
        "torch's default dtype",
        "torch",
        lambda m: m.get_default_dtype(),
        lambda m, value: m.set_default_dtype(value),
        fresh=lambda m: m.float32,
    ),
    Setting(
        "torch's default device",
        "torch",
        lambda m: str(m.get_default_device()),
        _write_default_device,
        fresh=_always("cpu"),
    ),
    Setting(
        "torch's autocast",
        "torch",
        lambda m: tuple(
            (m.is_autocast_enabled(name), m.get_autocast_dtype(name)) for name in _AUTOCAST
        ),
        _write_autocast,
        describe=_no_text,
    ),
    Setting(
        "torch's matmul precision",
        "torch",
        lambda m: m.get_float32_matmul_precision(),
        lambda m, value: m.set_float32_matmul_precision(value),
        fresh=_always("highest"),
    ),
    # After the one before, which sets these, too.
    Setting(
        "torch's float32 precision",
        "torch",
        lambda m: _read_attributes(m, _PRECISIONS),
        _write_attributes,
        describe=_no_text,
    ),
    Setting(
        "torch's deterministic algorithms",
        "torch",
        lambda m: (
            m.are_deterministic_algorithms_enabled(),
            m.is_deterministic_algorithms_warn_only_enabled(),
        ),
        lambda m, value: m.use_deterministic_algorithms(value[0], warn_only=value[1]),
        fresh=_always((False, False)),
    ),
    *(
        _attribute(f"cuDNN's `{name}`", "torch.backends.cudnn", name, fresh=_always(value))
        for name, value in (
            ("enabled", True),
            ("benchmark", False),
            ("deterministic", False),
            ("allow_tf32", True),
        )
    ),
    _attribute("oneDNN's `enabled`", "torch.backends.mkldnn", "enabled", fresh=_always(True)),
    Setting(
        "torch's kernels of attention",
        "torch",
        lambda m: [getattr(m.backends.cuda, f"{name}_sdp_enabled")() for name in _SDP],
        lambda m, value: [
            getattr(m.backends.cuda, f"enable_{name}_sdp")(on)
            for name, on in zip(_SDP, value, strict=True)
        ],
        fresh=_always([True] * len(_SDP)),
        describe=_no_text,
    ),
    _attribute("torch.load", "torch", "load"),
    Setting("torch's threads", "torch", _read_threads, lambda m, value: m.set_num_threads(value)),
    # Restored with the generator.
    Setting(
        "torch's seed",
        "torch",
        lambda m: m.initial_seed(),
        lambda m, value: None,
        describe=_no_text,
    ),
    Setting(
        "torch's random generator",
        "torch",
        lambda m: m.get_rng_state().numpy().tobytes(),
        lambda m, value: m.set_rng_state(m.frombuffer(bytearray(value), dtype=m.uint8)),
        quiet_in_load=True,
        describe=_no_text,
    ),
    Setting(
        "torch's random generators of GPUs",
        "torch",
        _of_gpu(_read_gpu_generators),
        lambda m, value: m.cuda.set_rng_state_all(
            [m.frombuffer(bytearray(one), dtype=m.uint8) for one in value]
        ),
        quiet_in_load=True,
        describe=_no_text,
    ),
)

SETTINGS: tuple[Setting, ...] = (*_INTERPRETER, *_NUMERIC, *_TORCH)
"""All settings that are kept, in the order in which they are restored."""
