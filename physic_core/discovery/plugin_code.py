"""Run code of plugins: none of its exceptions ends the process, and its output goes to stderr.

This is not a sandbox, since the user has installed the plugin. It protects a run from careless
plugins.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress

from physic_core.discovery.error_text import PluginExit, describe_error
from physic_core.errors import BackendError, PhysicError


@contextmanager
def plugin_code() -> Iterator[None]:
    """Run code of a plugin. Inside :func:`protected_stdout`, ``print`` writes to stderr.

    Raises:
        PluginExit: the plugin raised a BaseException that is not an Exception.
        KeyboardInterrupt: the user pressed Ctrl-C, or a handler of a signal raised one.
    """
    try:
        with redirect_stdout(sys.stderr) if _stdout_is_own else ExitStack():
            yield
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PluginExit(f"{type(error).__name__}: {error}".rstrip(": ")) from error


@contextmanager
def named_plugin_code(
    title: str, *owners: str | type, kind: type[PhysicError] = BackendError
) -> Iterator[None]:
    """Run code of a plugin as :func:`plugin_code` does, and convert its exceptions.

    Args:
        title: start of the message, which names the plugin.
        owners: the plugin's modules, by name, or its classes, to find its line in the traceback.
        kind: class of the exception.

    Raises:
        PhysicError: raised by the plugin itself, or of the class ``kind`` in place of another
            exception.
        MemoryError: raised by the plugin.
    """
    try:
        with plugin_code():
            yield
    except (PhysicError, MemoryError):
        raise
    except Exception as error:  # a plugin may raise anything
        raise kind(f"{title}: {describe_error(error, *owners)}") from error


_stdout_is_own = False


@contextmanager
def protected_stdout() -> Iterator[None]:
    """Keep the standard output for the command: what plugins write to file descriptor 1 goes to
    stderr.
    """
    global _stdout_is_own
    before = _stdout_is_own
    _stdout_is_own = True
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
        saved_descriptor = os.dup(number)
    except (AttributeError, OSError, ValueError):  # closed, or no file
        yield
        return
    stream.flush()
    with suppress(OSError):  # stderr is closed
        os.dup2(2, number)
    sys.stdout = open(  # noqa: SIM115 -- closed below, after the descriptor is restored
        saved_descriptor,
        "w",
        encoding=stream.encoding,
        errors=stream.errors,
        buffering=1 if stream.isatty() else -1,
    )
    stdout = sys.stdout
    try:
        yield
    finally:
        sys.stdout = stream
        with suppress(OSError, ValueError):
            stream.flush()
        with suppress(OSError):
            os.dup2(saved_descriptor, number)
        with suppress(OSError):  # of what could not be printed, which was reported
            stdout.close()  # writes what is buffered
