"""Discover the backends of all installed plugins, and the versions of distributions."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.metadata import EntryPoint, PackageNotFoundError, requires, version

from physic_core.discovery.claims import normal_name
from physic_core.discovery.entry_points import find
from physic_core.discovery.registration import GROUP
from physic_core.discovery.registry import Registry

__all__ = ["GROUP", "core_version", "discover", "required_versions"]

_NEEDED = re.compile(r"[\w.-]+")


def core_version() -> str:
    """Version of the installed physic-core."""
    return version("physic-core")


def required_versions(distribution: str) -> dict[str, str]:
    """Versions of a distribution's requirements without extras, by normal name; empty if it is not installed."""
    found = {}
    with suppress(PackageNotFoundError, ValueError):  # ValueError: the name is empty
        for line in requires(distribution) or ():
            name, marker = _NEEDED.match(line), line.partition(";")[2]
            if name and "extra" not in marker:
                with suppress(PackageNotFoundError):
                    found[normal_name(name[0])] = version(name[0])
    return found


def discover(
    installed: Iterable[EntryPoint] | None = None,
    *,
    environment: Mapping[str, str] = os.environ,
    clock: Callable[[], float] = time.perf_counter,
) -> Registry:
    """Find the backends of all installed plugins. A broken plugin is listed in ``broken`` and raises nothing.

    Args:
        installed: entry points; None for those of this Python.
        environment: ``PHYSIC_PLUGINS=a,b`` in it leaves only the distributions or entry points of these names, empty
            leaves none, and the others are not even imported.
        clock: seconds.
    """
    found = find(installed, environment=environment, clock=clock)
    return Registry(
        found.claims, found.broken, restriction=found.restriction, manifests=found.manifests, installed=False
    )
