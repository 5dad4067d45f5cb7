"""The exit code of every command, by the class of its error; the only place that knows them."""

from __future__ import annotations

from physic_core.errors import (
    BackendError,
    BackendNotFoundError,
    BodyModelError,
    ConfigError,
    DeviceError,
    DownloadError,
    InputError,
    NoPersonError,
    OutputError,
    WeightsMissingError,
)

__all__ = ["BACKEND", "EXIT_CODES", "INPUT", "INTERRUPTED", "MEANINGS", "OTHER", "USAGE", "WEIGHTS", "exit_code"]

OTHER, USAGE, INPUT, WEIGHTS, BACKEND, INTERRUPTED = 1, 2, 3, 4, 5, 130

MEANINGS = {
    0: "done",
    OTHER: "an error that is none of these",
    USAGE: "wrong arguments, configuration, device or output folder",
    INPUT: "a photo or file that cannot be used, or no person in the photo",
    WEIGHTS: "weights are missing, differ from the published files, or cannot be fetched",
    BACKEND: "a backend or plugin failed",
    INTERRUPTED: "Ctrl-C",
}
"""What ``physic --help`` and README say of each."""

EXIT_CODES: dict[type[Exception], int] = {
    BodyModelError: USAGE,
    BackendNotFoundError: USAGE,
    ConfigError: USAGE,
    DeviceError: USAGE,
    OutputError: USAGE,
    InputError: INPUT,
    NoPersonError: INPUT,
    DownloadError: WEIGHTS,
    WeightsMissingError: WEIGHTS,
    BackendError: BACKEND,
}
"""A class that is not listed has the code of its nearest base."""


def exit_code(error: BaseException) -> int:
    """The code that a command ends with after this error."""
    return next((EXIT_CODES[kind] for kind in type(error).__mro__ if kind in EXIT_CODES), OTHER)
