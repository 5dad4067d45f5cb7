"""Exit codes of all commands, by error class.

Code 2: the user has to correct the arguments or the configuration. Code 5: the author of a plugin has to correct the
plugin. A configuration with errors of both kinds exits with 2.
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

OTHER, USAGE, INPUT, WEIGHTS, BACKEND, INTERRUPTED = 1, 2, 3, 4, 5, 130

MEANINGS = {
    0: "done",
    OTHER: "any other error",
    USAGE: "wrong arguments, configuration, device or output folder",
    INPUT: "an unusable photo or file, or a chosen or required person is not in the photo",
    WEIGHTS: "weights or an optional package are missing, or weights differ from the published files",
    BACKEND: "a backend or plugin failed",
    INTERRUPTED: "Ctrl-C",
}
"""Meaning of each exit code, as printed by ``physic --help``."""

EXIT_CODES: dict[type[Exception], int] = {
    BodyModelError: USAGE,
    AmbiguousBackendError: USAGE,
    BackendNotFoundError: USAGE,
    ConfigError: USAGE,
    DeviceError: USAGE,
    OutputError: USAGE,
    InputError: INPUT,
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
