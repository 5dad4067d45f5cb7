"""One photo in; people, scene and contact out, in one metric camera frame (OpenCV axes, metres).

Importing this imports next to nothing: all names but the errors are fetched when they are first used, so that a command
that only looks around does not pay for those that compute.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from physic_core.errors import (
    BackendError,
    BackendNotFoundError,
    BackendOutputError,
    BodyModelError,
    ConfigError,
    DeviceError,
    InputError,
    NoPersonError,
    OutputError,
    PhysicError,
    WeightsMissingError,
)

if TYPE_CHECKING:
    from physic_core.config import Config, load_config
    from physic_core.hookspecs import hookimpl
    from physic_core.pipeline import reconstruct
    from physic_core.plugins import discover
    from physic_core.registry import BackendRecord, Registry
    from physic_core.types import Intrinsics, Person, Reconstruction, Scene

__all__ = [
    "BackendError",
    "BackendNotFoundError",
    "BackendOutputError",
    "BackendRecord",
    "BodyModelError",
    "Config",
    "ConfigError",
    "DeviceError",
    "InputError",
    "Intrinsics",
    "NoPersonError",
    "OutputError",
    "Person",
    "PhysicError",
    "Reconstruction",
    "Registry",
    "Scene",
    "WeightsMissingError",
    "discover",
    "hookimpl",
    "load_config",
    "reconstruct",
]

_ON_FIRST_USE = {
    "BackendRecord": "physic_core.registry",
    "Config": "physic_core.config",
    "Intrinsics": "physic_core.types",
    "Person": "physic_core.types",
    "Reconstruction": "physic_core.types",
    "Registry": "physic_core.registry",
    "Scene": "physic_core.types",
    "discover": "physic_core.plugins",
    "hookimpl": "physic_core.hookspecs",
    "load_config": "physic_core.config",
    "reconstruct": "physic_core.pipeline",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from physic_core.plugins import core_version

        return core_version()
    if name not in _ON_FIRST_USE:
        raise AttributeError(f"module 'physic_core' has no attribute '{name}'")
    return getattr(import_module(_ON_FIRST_USE[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
