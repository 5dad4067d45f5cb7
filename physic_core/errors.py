"""The errors that PhySIC raises; each message states what is wrong, what was given, and what to do."""

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
    """Base class of every error that PhySIC raises."""


class InputError(PhysicError):
    """A photo or a file that cannot be used."""


class OutputError(PhysicError):
    """A file or folder that cannot be written."""


class ConfigError(PhysicError):
    """An invalid configuration; the message lists all faults."""


class DeviceError(PhysicError):
    """A compute device that does not exist on this machine."""


class DownloadError(PhysicError):
    """Weights that could not be fetched, or whose licence the user has not accepted."""


class BodyModelError(PhysicError):
    """A body model file that cannot be used, or parameters that belong to another body."""


class BackendError(PhysicError):
    """A backend that is broken, or that failed while it ran."""


class BackendNotFoundError(BackendError):
    """A backend name that no installed plugin offers."""


class AmbiguousBackendError(BackendError):
    """A backend name that several distributions offer; "distribution:name" chooses one."""


class WeightsMissingError(BackendError):
    """Files that a run needs and that are missing on this machine; the message states how to get each."""


class BackendOutputError(BackendError):
    """A backend whose output its interface does not allow."""


class PluginError(PhysicError):
    """A plugin whose command cannot be imported, or is not a command."""


class NoPersonError(PhysicError):
    """A photo in which no person was found."""
