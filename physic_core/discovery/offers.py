"""Records of backends with the plugin that offers them, and the validation of records."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from physic_core.discovery.local_modules import TARGET

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.discovery.records import BackendRecord

_NAME = re.compile(r"[a-z0-9]+([.-][a-z0-9]+)*")
_RESERVED_NAMES = ("none",)


@dataclass(frozen=True)
class Origin:
    """The plugin that a backend, command or weight manifest comes from.

    Attributes:
        plugin: import name of the plugin's module.
        distribution: name of the installed distribution.
        version: version of the distribution.
        seconds: time to import the plugin and call its hooks.
    """

    plugin: str
    distribution: str
    version: str = ""
    seconds: float = field(default=0.0, compare=False)

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip()


GIVEN_IN_PYTHON = Origin("", "given in Python")
REGISTERED_BY_HAND = Origin("", "registered by hand")
NAMED_IN_CONFIG = Origin("", "named in the config")
UNREGISTERED_CLASS = Origin("", "a class that no plugin registers")


@dataclass(frozen=True)
class BackendOffer:
    """One backend that a plugin offers.

    Attributes:
        record: record of the backend.
        origin: the plugin.
        problem: reason why the record is invalid; empty if it is valid.
    """

    record: BackendRecord
    origin: Origin
    problem: str = ""

    def __str__(self) -> str:
        return f"{self.record.interface} '{self.record.name}' ({self.origin})"


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin that cannot be imported, or has a hook that fails.

    Attributes:
        origin: the plugin.
        cause: reason of the failure, one line.
        error: the exception, if there was one.
    """

    origin: Origin
    cause: str
    error: BaseException | None = field(default=None, compare=False)

    def __str__(self) -> str:
        return f"{self.origin} ({self.cause})"


@dataclass(frozen=True)
class Manifest:
    """Path of a plugin's weight manifest.

    Attributes:
        origin: the plugin.
        path: a TOML file, or a folder of them, for :func:`physic_core.weights.read_manifest`.
    """

    origin: Origin
    path: Path


def backend_record_problem(record: BackendRecord, origin: Origin) -> str:
    """Return the reason why a record is invalid, or an empty text if it is valid."""
    from physic_core.interfaces import INTERFACES

    if record.interface not in INTERFACES:
        from physic_core.discovery.close_names import closest_name

        close = closest_name(str(record.interface), INTERFACES)
        hint = f"did you mean '{close}'?" if close else f"there are: {', '.join(INTERFACES)}"
        return f"no interface named '{record.interface}'; {hint}"
    if not isinstance(record.name, str) or not _NAME.fullmatch(record.name) or record.name in _RESERVED_NAMES:
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


def canonicalize_name(distribution: str) -> str:
    """Return a distribution name in lower case, with hyphens, for comparison (PEP 503)."""
    return re.sub(r"[-_.]+", "-", distribution).lower()


def with_article(interface: str) -> str:
    """Return the name of an interface with its article."""
    return f"an {interface}" if interface[0] in "aeiou" else f"a {interface}"
