"""Backends offered by installed plugins, and whether their records are valid. No backend is imported."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import TYPE_CHECKING

from physic_core.discovery.local_modules import TARGET

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.discovery.records import BackendRecord

__all__ = [
    "BY_CLASS",
    "BY_HAND",
    "IN_CONFIG",
    "BrokenPlugin",
    "Claim",
    "Manifest",
    "Origin",
    "normal_name",
    "problem_of",
]

_NAME = re.compile(r"[a-z0-9]+([.-][a-z0-9]+)*")
_RESERVED = ("none",)


@dataclass(frozen=True)
class Origin:
    """The plugin of a backend, command or list of weights.

    Attributes:
        plugin: import name of the plugin's module.
        distribution: installed distribution.
        version: of the distribution.
        seconds: time to import the plugin and call its hooks.
    """

    plugin: str
    distribution: str
    version: str = ""
    seconds: float = field(default=0.0, compare=False)

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip()


BY_HAND = Origin("", "registered by hand")
IN_CONFIG = Origin("", "named in the config")
BY_CLASS = Origin("", "a class that no plugin registers")


@dataclass(frozen=True)
class Claim:
    """One backend offered by one plugin.

    Attributes:
        record: of the backend.
        origin: the plugin.
        problem: why it cannot be used; empty if it can.
    """

    record: BackendRecord
    origin: Origin
    problem: str = ""

    def __str__(self) -> str:
        return f"{self.record.interface} '{self.record.name}' ({self.origin})"


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin that cannot be imported, or that has a failing hook.

    Attributes:
        origin: the plugin.
        cause: of the failure, one line.
        error: the exception itself, if there was one.
    """

    origin: Origin
    cause: str
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.origin} ({self.cause})"


@dataclass(frozen=True)
class Manifest:
    """The list of weights of a plugin.

    Attributes:
        origin: the plugin.
        path: a TOML file, or a folder of them, for :func:`physic_core.weights.read_manifest`.
    """

    origin: Origin
    path: Path


def problem_of(record: BackendRecord, origin: Origin) -> str:
    """Why a record cannot be used; empty if it can."""
    from physic_core.interfaces import INTERFACES

    if record.interface not in INTERFACES:
        close = get_close_matches(str(record.interface), INTERFACES, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(INTERFACES)}"
        return f"no interface named '{record.interface}'; {hint}"
    if not isinstance(record.name, str) or not _NAME.fullmatch(record.name) or record.name in _RESERVED:
        return f"its name should be of a-z, 0-9 and hyphens, and not 'none', got {record.name!r}"
    if isinstance(record.target, str) and not TARGET.fullmatch(record.target):
        return f"its target should be 'package.module:Class', got {record.target!r}"
    ours = INTERFACES[record.interface].api
    if not isinstance(record.api, int):
        return f"its api should be a whole number such as {ours}, got {record.api!r}"
    if record.api != ours:
        older = "physic-core" if record.api > ours else origin.distribution
        return (
            f"written for version {record.api} of the interface {record.interface}, "
            f"and this physic-core has version {ours}: upgrade {older}"
        )
    return ""


def normal_name(distribution: str) -> str:
    """A distribution's name in lower case, with hyphens, for comparison."""
    return re.sub(r"[-_.]+", "-", distribution).lower()
