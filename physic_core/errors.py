"""Exceptions of PhySIC; each message states what is wrong, what was given, and what to do."""

from __future__ import annotations

import re

__all__ = [
    "AmbiguousBackendError",
    "BackendError",
    "BackendNotFoundError",
    "BackendOutputError",
    "BodyModelError",
    "ConfigError",
    "DeviceError",
    "DownloadError",
    "InputError",
    "NoPersonError",
    "OutputError",
    "PackageMissingError",
    "PhysicError",
    "PluginError",
    "WeightsMissingError",
]


_LONGEST = 6000  # characters of a message, which may quote a file or a library
_ADDRESS = re.compile(r" at 0x[0-9a-f]{6,}")


class PhysicError(Exception):
    """Base class of all exceptions of PhySIC.

    A message has no addresses of objects, and of a long one the middle is left out.
    """

    def __init__(self, *values: object) -> None:
        super().__init__(*(_short(one) if isinstance(one, str) else one for one in values))


def _short(text: str) -> str:
    text = _ADDRESS.sub("", text)
    if len(text) <= _LONGEST:
        return text
    return f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 3 :]}"


class InputError(PhysicError):
    """Raised if a photo or an input file cannot be used."""


class OutputError(PhysicError):
    """Raised if a file or folder cannot be written."""


class ConfigError(PhysicError):
    """Raised for an invalid configuration or argument; the message lists all errors in it."""


class PackageMissingError(ConfigError, InputError):
    """Raised if an optional package that a format of files needs is not installed."""


class DeviceError(PhysicError):
    """Raised if the requested compute device does not exist on this machine."""


class DownloadError(PhysicError):
    """Raised if weights cannot be downloaded, or their license is not accepted."""


class BodyModelError(PhysicError):
    """Raised if a body model file is invalid, or parameters are for another body model."""


class BackendError(PhysicError):
    """Raised if a backend cannot be imported or fails in a call."""


class BackendNotFoundError(BackendError):
    """Raised if no installed plugin offers a backend with this name."""


class AmbiguousBackendError(BackendError):
    """Raised if several distributions offer a backend with this name; "distribution:name" selects
    one.
    """


class WeightsMissingError(BackendError):
    """Raised if files that a run needs are missing; the message states how to get each."""


class BackendOutputError(BackendError):
    """Raised if the result of a backend violates its interface."""


class PluginError(PhysicError):
    """Raised if the command of a plugin cannot be imported, or is not a command."""


class NoPersonError(PhysicError):
    """Raised if a chosen or required person is not found in a photo, or a metric depth needs people
    and gets none.
    """
