"""What can go wrong, one class for each thing that a caller may want to catch.

A message says what was wrong, what came, and what to do.
"""

from __future__ import annotations

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
    "PhysicError",
    "PluginError",
    "WeightsMissingError",
]


class PhysicError(Exception):
    """Base of every error that PhySIC raises on purpose."""


class InputError(PhysicError):
    """A photo or a file that cannot be used."""


class OutputError(PhysicError):
    """A place that cannot be written."""


class ConfigError(PhysicError):
    """A configuration that does not hold; the message lists every fault at once."""


class DeviceError(PhysicError):
    """A compute device that is not there."""


class DownloadError(PhysicError):
    """Weights that could not be fetched, or not without the user's word about their licence."""


class BodyModelError(PhysicError):
    """A body model file that cannot be used, or parameters that belong to another body."""


class BackendError(PhysicError):
    """A backend that is broken, or that failed while it ran."""


class BackendNotFoundError(BackendError):
    """A backend name that nothing installed offers."""


class AmbiguousBackendError(BackendError):
    """A backend name that several distributions offer; "distribution:name" chooses one."""


class WeightsMissingError(BackendError):
    """Files that a backend needs and that are not on this machine; the message says how to get each."""


class BackendOutputError(BackendError):
    """A backend that answered something that its interface does not allow."""


class PluginError(PhysicError):
    """A plugin whose command cannot be imported, or is not a command."""


class NoPersonError(PhysicError):
    """A photo in which nobody was found."""
