"""Exit codes of all commands, by error class.

A code says what has to be mended, wherever the error was found. 2: an argument, a setting or the
output folder. 3: a file that one of them names, or the choice of the photo. 4: what is installed.
5: a plugin, by its author.
"""

from __future__ import annotations

from physic_core.errors import (
    AmbiguousBackendError,
    BackendError,
    BackendNotFoundError,
    BodyModelError,
    ConfigError,
    DeviceError,
    DownloadError,
    InputError,
    NoPersonError,
    OutputError,
    PackageMissingError,
    PluginError,
    WeightsMissingError,
)

OTHER = 1
USAGE = 2
INPUT = 3
WEIGHTS = 4
BACKEND = 5
INTERRUPTED = 130

MEANINGS = {
    0: "done",
    OTHER: "any other error",
    USAGE: "wrong arguments, configuration, device or output folder",
    INPUT: "an unusable photo or file, or a chosen or required person is not in the photo",
    WEIGHTS: "weights or an optional package are missing, or weights differ from the published "
    "files",
    BACKEND: "a backend or plugin failed",
    INTERRUPTED: "Ctrl-C",
}
"""Meaning of each exit code, as printed by ``physic --help``."""

EXIT_CODES: dict[type[Exception], int] = {
    AmbiguousBackendError: USAGE,
    BackendNotFoundError: USAGE,
    ConfigError: USAGE,
    DeviceError: USAGE,
    OutputError: USAGE,
    InputError: INPUT,
    BodyModelError: INPUT,
    NoPersonError: INPUT,
    DownloadError: WEIGHTS,
    PackageMissingError: WEIGHTS,
    WeightsMissingError: WEIGHTS,
    BackendError: BACKEND,
    PluginError: BACKEND,
}
"""Exit code of each error class; other classes use the code of their nearest base class."""


def exit_code(error: BaseException) -> int:
    """Return the exit code of a command that ended with this error."""
    return next((EXIT_CODES[kind] for kind in type(error).__mro__ if kind in EXIT_CODES), OTHER)
