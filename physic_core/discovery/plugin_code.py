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
from operator import methodcaller
from typing import Any, NamedTuple

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
        for setting in _SETTINGS:
            restored.callback(setting.restore, setting.read())
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


class _Setting(NamedTuple):
    """A setting of a module: how it is read and set, and its value in a module that the plugin has imported."""

    module: str
    get: Callable[[Any], Any]
    set: Callable[[Any, Any], object]
    initial: Any = None

    def read(self) -> Any:
        """Return the value; ``initial`` if the module is not imported, or only in part."""
        module = sys.modules.get(self.module)
        is_partial = getattr(getattr(module, "__spec__", None), "_initializing", False)  # another thread imports it
        try:
            return self.initial if module is None or is_partial else self.get(module)
        except (AttributeError, OSError):  # OSError: the current folder was deleted
            return self.initial

    def restore(self, value: Any) -> None:
        """Set a value of :meth:`read` again, if it has changed; None stands for no value."""
        if value is not None and self.read() != value:
            self.set(sys.modules[self.module], value)


def _of_torch(get: str, set_: str, initial: Any = None) -> _Setting:
    return _Setting("torch", methodcaller(get), lambda torch, value: getattr(torch, set_)(value), initial)


def _change_folder(module: Any, folder: str) -> None:
    with suppress(OSError):
        module.chdir(folder)


def _random_of_numpy(random: Any) -> Any:
    name, keys, *rest = random.get_state()
    return name, keys.tobytes(), *rest


def _restore_random_of_numpy(random: Any, state: Any) -> None:
    import numpy as np

    name, keys, *rest = state
    random.set_state((name, np.frombuffer(keys, np.uint32).copy(), *rest))


def _restore_device(torch: Any, device: str) -> None:
    torch.set_default_device(None)
    if str(torch.get_default_device()) != device:
        torch.set_default_device(device)


_SETTINGS = (
    _Setting("os", lambda os: os.getcwd(), _change_folder),
    _Setting(
        "locale", lambda _: locale.setlocale(locale.LC_ALL), lambda _, name: locale.setlocale(locale.LC_ALL, name)
    ),
    _Setting("sys", lambda sys: sys.getrecursionlimit(), lambda sys, limit: sys.setrecursionlimit(limit)),
    _Setting("random", lambda random: random.getstate(), lambda random, state: random.setstate(state)),
    _Setting(
        "numpy",
        lambda numpy: numpy.geterr(),
        lambda numpy, errors: numpy.seterr(**errors),
        {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"},
    ),
    _Setting("numpy", lambda numpy: (numpy.geterrcall(),), lambda numpy, call: numpy.seterrcall(*call), (None,)),
    _Setting("numpy.random", _random_of_numpy, _restore_random_of_numpy),
    _Setting(
        "torch",
        lambda torch: str(torch.get_default_dtype()).removeprefix("torch."),
        lambda torch, name: torch.set_default_dtype(getattr(torch, name)),
        "float32",
    ),
    _Setting("torch", lambda torch: str(torch.get_default_device()), _restore_device, "cpu"),
    _of_torch("is_grad_enabled", "set_grad_enabled", True),
    _of_torch("get_num_threads", "set_num_threads"),
    _of_torch("are_deterministic_algorithms_enabled", "use_deterministic_algorithms"),
    _of_torch("get_float32_matmul_precision", "set_float32_matmul_precision", "highest"),
    _Setting(
        "torch",
        lambda torch: torch.is_anomaly_enabled(),
        lambda torch, wanted: torch.autograd.set_detect_anomaly(wanted),
        False,
    ),
    _Setting(
        "torch",
        lambda torch: torch.get_rng_state().numpy().tobytes(),
        lambda torch, state: torch.set_rng_state(torch.frombuffer(bytearray(state), dtype=torch.uint8)),
    ),
)
