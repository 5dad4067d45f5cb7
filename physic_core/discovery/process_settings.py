"""The settings of a process by which code of networks changes the numbers of others in practice.

They are restored after each call. Others, such as numpy's treatment of errors, are found by the
conformance kit.
"""

from __future__ import annotations

# Rows below name these modules.
import operator
import os  # noqa: F401
import random  # noqa: F401
import signal  # noqa: F401
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

IMPORTED = frozenset(
    # torch, OpenCV, Ray
    {"CUDA_MODULE_LOADING", "LD_LIBRARY_PATH", "RAY_CLIENT_MODE", "TORCHINDUCTOR_CACHE_DIR"}
    | {"KMP_DUPLICATE_LIB_OK", "KMP_INIT_AT_FORK"}  # scikit-learn
)
"""Environment variables that libraries set for themselves when they are imported or begin."""

LIMITING = "import torch"
"""Name of the thread that imports torch, and then limits its threads."""


def _no_text(before: Any, after: Any) -> str:
    return ""


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
    describe: Callable[[Any, Any], str] = _no_text


def _arrow(before: Any, after: Any) -> str:
    return f"{before} -> {after}"


# ---- the interpreter
# -------------------------------------------------------------------------------------------------


def _read_environment(module: Any) -> dict[str, str]:
    return {name: value for name, value in module.environ.items() if name not in IMPORTED}


def _restore_environment(module: Any, before: dict[str, str]) -> None:
    for name in _read_environment(module).keys() - before.keys():
        del module.environ[name]
    module.environ.update(before)


def _changed_names(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Return the names whose values differ, without the values: those of variables may be
    secret.
    """
    return ", ".join(
        sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    )


def _read_handlers(module: Any) -> dict[str, Any]:
    return {name: module.getsignal(getattr(module, name)) for name in ("SIGINT", "SIGTERM")}


def _restore_handlers(module: Any, before: dict[str, Any]) -> None:
    for name, handler in before.items():
        module.signal(getattr(module, name), handler)


def _read_numpy_generator(module: Any) -> tuple[Any, ...]:
    """Return what shows a change, and the generator and its state."""
    generator = module.get_bit_generator()
    state = module.get_state(legacy=False)
    values = [
        value.tobytes() if hasattr(value, "tobytes") else value for value in state["state"].values()
    ]
    return (id(generator), values, state["has_gauss"], state["gauss"]), generator, state


def _restore_numpy_generator(module: Any, value: tuple[Any, ...]) -> None:
    _, generator, state = value
    module.set_bit_generator(generator)
    module.set_state(state)


def _default_opencv_threads(cv2: Any) -> int:
    current = cv2.getNumThreads()
    cv2.setNumThreads(-1)
    default: int = cv2.getNumThreads()
    cv2.setNumThreads(current)
    return default


# ---- torch
# -------------------------------------------------------------------------------------------------

_GUARDS = list[Any]()  # a guard of torch ends when it is collected


def _restore_inference_mode(torch: Any, value: bool) -> None:
    guard = torch.inference_mode(value)
    guard.__enter__()
    _GUARDS.append(guard)


def _read_modes(torch: Any) -> tuple[list[Any], list[Any]]:
    """Return the modes of functions, of which the default device is one, and of dispatch."""
    dispatch = torch.utils._python_dispatch
    return (
        torch.overrides._get_current_function_mode_stack(),
        dispatch._get_current_dispatch_mode_stack(),
    )


def _restore_modes(torch: Any, before: tuple[list[Any], list[Any]]) -> None:
    torch.set_default_device(None)
    kinds = torch.overrides, torch.utils._python_dispatch
    for kind, wanted, found in zip(kinds, before, _read_modes(torch), strict=True):
        for _ in found:
            kind._pop_mode()
        for mode in wanted:
            kind._push_mode(mode)


def _read_threads(torch: Any) -> int:
    # A thread that limits them has imported torch, and has yet to say its number.
    for thread in threading.enumerate():
        if thread.name == LIMITING:
            thread.join()
    count: int = torch.get_num_threads()
    return count


def _read_gpu_generators(torch: Any) -> list[bytes]:
    """Return the states of the generators of GPUs in use; most functions would start one."""
    if not torch.cuda.is_initialized():
        raise RuntimeError("no GPU is in use")
    return [state.numpy().tobytes() for state in torch.cuda.get_rng_state_all()]


SETTINGS: tuple[Setting, ...] = (
    Setting(
        "the current folder",
        "os",
        lambda m: m.getcwd(),
        lambda m, value: m.chdir(value),
        describe=_arrow,
    ),
    Setting(
        "the environment", "os", _read_environment, _restore_environment, describe=_changed_names
    ),
    Setting(
        "handlers of signals", "signal", _read_handlers, _restore_handlers, describe=_changed_names
    ),
    Setting(
        "the generator of `random`",
        "random",
        lambda m: m.getstate(),
        lambda m, value: m.setstate(value),
    ),
    Setting(
        "numpy's random generator",
        "numpy.random",
        _read_numpy_generator,
        _restore_numpy_generator,
        same=lambda earlier, later: bool(earlier[0] == later[0]),
    ),
    Setting(
        "OpenCV's threads",
        "cv2",
        lambda m: m.getNumThreads(),
        lambda m, value: m.setNumThreads(value),
        _default_opencv_threads,
        describe=_arrow,
    ),
    # The first one of torch: under a mode, tensors of the others may not exist.
    Setting("torch's modes", "torch", _read_modes, _restore_modes, lambda _: ([], [])),
    Setting(
        "torch's inference mode",
        "torch",
        lambda m: m.is_inference_mode_enabled(),
        _restore_inference_mode,
        lambda _: False,
    ),
    Setting(
        "torch's gradient mode",
        "torch",
        lambda m: m.is_grad_enabled(),
        lambda m, value: m.set_grad_enabled(value),
        lambda _: True,
    ),
    Setting(
        "torch's default dtype",
        "torch",
        lambda m: m.get_default_dtype(),
        lambda m, value: m.set_default_dtype(value),
        lambda m: m.float32,
        describe=_arrow,
    ),
    Setting(
        "torch's threads",
        "torch",
        _read_threads,
        lambda m, value: m.set_num_threads(value),
        describe=_arrow,
    ),
    Setting(
        "torch's random generator",
        "torch",
        lambda m: m.get_rng_state().numpy().tobytes(),
        lambda m, value: m.set_rng_state(m.frombuffer(bytearray(value), dtype=m.uint8)),
        quiet_in_load=True,
    ),
    Setting(
        "torch's random generators of GPUs",
        "torch",
        _read_gpu_generators,
        lambda m, value: m.cuda.set_rng_state_all(
            [m.frombuffer(bytearray(one), dtype=m.uint8) for one in value]
        ),
        quiet_in_load=True,
    ),
)
"""All settings that are kept, in the order in which they are restored."""
