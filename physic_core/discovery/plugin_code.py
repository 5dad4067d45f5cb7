"""Run code of plugins: what it does to the process is undone, and it cannot end the process with an exception.

This is no sandbox: a plugin is code that the user has installed. It protects a run from plugins that are careless.
"""

from __future__ import annotations

import locale
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from typing import Any

__all__ = ["PluginExit", "own_stdout", "plugin_code", "plugin_error"]

_STANDARD_STREAMS = (0, 1, 2)


class PluginExit(Exception):
    """Raised in place of SystemExit, KeyboardInterrupt or another BaseException of a plugin, which is its cause."""


def plugin_error(error: BaseException) -> BaseException:
    """Return the exception that a plugin raised: the cause of a PluginExit, or the error itself."""
    return error.__cause__ if isinstance(error, PluginExit) and error.__cause__ is not None else error


@contextmanager
def plugin_code() -> Iterator[None]:
    """Run code of a plugin, and restore the state of the process after it.

    Restored are the current folder, file descriptors 0-2, warning filters, locale, recursion limit, handlers of
    signals, error handling of NumPy, states of the random number generators of Python, NumPy and torch, and torch's
    default type and device, gradient mode, precision of products, search for anomalies and threads. Pillow's switches
    are set by the reader of photos, whenever it decodes. Inside :func:`own_stdout`, ``print`` writes to stderr.

    Raises:
        PluginExit: the plugin raised a BaseException that is no Exception.
        BaseException: a handler of a signal raised it, such as KeyboardInterrupt after Ctrl-C; also if the plugin has
            suppressed it.
    """
    raised: list[BaseException] = []
    with ExitStack() as restored:
        restored.enter_context(_signal_handlers(raised))
        restored.enter_context(_standard_streams())
        restored.enter_context(warnings.catch_warnings())
        for get, restore in _STATES:
            restored.callback(_restore_if_changed, get, restore, get())
        if _stdout_is_own:
            restored.enter_context(redirect_stdout(sys.stderr))
        try:
            yield
        except Exception:
            if raised:
                raise raised[0] from None
            raise
        except BaseException as error:
            if raised:
                raise raised[0] from None
            raise PluginExit(f"{type(error).__name__}: {error}".rstrip(": ")) from error
        if raised:
            raise raised[0]


_stdout_is_own = False


@contextmanager
def own_stdout() -> Iterator[None]:
    """Keep the standard output for the command: what plugins write to file descriptor 1 goes to stderr."""
    global _stdout_is_own
    before, _stdout_is_own = _stdout_is_own, True
    try:
        with _separate_stdout() if sys.stdout is sys.__stdout__ else ExitStack():
            yield
    finally:
        _stdout_is_own = before


@contextmanager
def _separate_stdout() -> Iterator[None]:
    stream = sys.stdout
    try:
        number = stream.fileno()
        kept = os.dup(number)
    except (AttributeError, OSError, ValueError):  # closed, or no file
        yield
        return
    stream.flush()
    with suppress(OSError):  # stderr is closed
        os.dup2(2, number)
    sys.stdout = open(  # noqa: SIM115 -- closed below, after the descriptor is restored
        kept, "w", encoding=stream.encoding, errors=stream.errors, buffering=1 if stream.isatty() else -1
    )
    own = sys.stdout
    try:
        yield
    finally:
        sys.stdout = stream
        with suppress(OSError, ValueError):
            stream.flush()
        with suppress(OSError):
            os.dup2(kept, number)
        own.close()  # writes what is buffered


@contextmanager
def _signal_handlers(raised: list[BaseException]) -> Iterator[None]:
    """Record what handlers of signals raise, and restore the handlers; only the main thread runs handlers."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in signal.valid_signals()}

    def recording(handler: Callable[..., Any]) -> Callable[..., None]:
        def handle(number: int, frame: Any) -> None:
            try:
                handler(number, frame)
            except BaseException as error:
                raised.append(error)
                raise

        return handle

    for number, handler in before.items():
        if callable(handler):
            signal.signal(number, recording(handler))
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None and signal.getsignal(number) is not handler:
                signal.signal(number, handler)


@contextmanager
def _standard_streams() -> Iterator[None]:
    """Open file descriptors 0-2 again if they were closed or replaced."""
    kept = {}
    for number in _STANDARD_STREAMS:
        with suppress(OSError):
            kept[number] = os.dup(number)
    try:
        yield
    finally:
        for number, copy in kept.items():
            with suppress(OSError):
                if not _same_file(number, copy):
                    os.dup2(copy, number)
            with suppress(OSError):
                os.close(copy)


def _same_file(one: int, other: int) -> bool:
    try:
        return os.path.sameopenfile(one, other)
    except OSError:
        return False


def _restore_if_changed(get: Callable[[], Any], restore: Callable[[Any], object], before: Any) -> None:
    if get() != before:
        restore(before)


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it was deleted
        return None


def _change_folder(folder: str | None) -> None:
    if folder is not None:
        with suppress(OSError):
            os.chdir(folder)


def _random() -> Any:
    """Return the state of Python's random numbers; None if nothing has imported them."""
    random = sys.modules.get("random")
    return random.getstate() if random is not None and hasattr(random, "getstate") else None


def _restore_random(state: Any) -> None:
    if state is not None:
        sys.modules["random"].setstate(state)


def _numpy_errors() -> Any:
    """Return NumPy's error handling; its default if NumPy is not imported."""
    numpy = sys.modules.get("numpy")
    if numpy is None or not hasattr(numpy, "geterr"):
        return {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}, None
    return numpy.geterr(), numpy.geterrcall()


def _restore_numpy_errors(state: Any) -> None:
    import numpy as np

    errors, call = state
    np.seterr(**errors)
    np.seterrcall(call)


def _numpy_random() -> Any:
    """Return the state of NumPy's global random numbers; None if nothing has imported them."""
    random = sys.modules.get("numpy.random")
    if random is None or not hasattr(random, "get_state"):
        return None
    name, keys, *rest = random.get_state()
    return name, keys.tobytes(), *rest


def _restore_numpy_random(state: Any) -> None:
    import numpy as np

    if state is not None:
        name, keys, *rest = state
        np.random.set_state((name, np.frombuffer(keys, np.uint32).copy(), *rest))


def _torch() -> Any:
    """Return settings of torch and the state of its random numbers; None if it is not imported."""
    torch = sys.modules.get("torch")
    if torch is None or not hasattr(torch, "get_default_device"):
        return None
    return (
        torch.get_default_dtype(),
        torch.get_default_device(),
        torch.is_grad_enabled(),
        torch.get_num_threads(),
        torch.are_deterministic_algorithms_enabled(),
        torch.get_float32_matmul_precision(),
        torch.is_anomaly_enabled(),
        torch.get_rng_state().numpy().tobytes(),
    )


def _restore_torch(state: Any) -> None:
    import torch

    if state is None:  # imported by the plugin
        torch.set_default_dtype(torch.float32)
        torch.set_default_device(None)
        torch.set_grad_enabled(True)
        torch.set_float32_matmul_precision("highest")
        torch.autograd.set_detect_anomaly(False)
        return
    dtype, device, gradients, threads, deterministic, precision, anomaly, random_numbers = state
    torch.set_default_dtype(dtype)
    if torch.get_default_device() != device:
        torch.set_default_device(None)
        if torch.get_default_device() != device:
            torch.set_default_device(device)
    torch.set_grad_enabled(gradients)
    if torch.get_num_threads() != threads:
        torch.set_num_threads(threads)
    torch.use_deterministic_algorithms(deterministic)
    torch.set_float32_matmul_precision(precision)
    torch.autograd.set_detect_anomaly(anomaly)
    torch.set_rng_state(torch.frombuffer(bytearray(random_numbers), dtype=torch.uint8))


_STATES: tuple[tuple[Callable[[], Any], Callable[[Any], object]], ...] = (
    (_folder, _change_folder),
    (lambda: locale.setlocale(locale.LC_ALL), lambda name: locale.setlocale(locale.LC_ALL, name)),
    (sys.getrecursionlimit, sys.setrecursionlimit),
    (_random, _restore_random),
    (_numpy_errors, _restore_numpy_errors),
    (_numpy_random, _restore_numpy_random),
    (_torch, _restore_torch),
)
