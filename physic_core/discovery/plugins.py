"""Find the backends of all installed plugins, and the versions of distributions."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.metadata import EntryPoint, PackageNotFoundError, requires, version

from physic_core.discovery.entry_points import find_plugins
from physic_core.discovery.offers import canonicalize_name
from physic_core.discovery.registration import ENTRY_POINT_GROUPS, PLUGINS_GROUP
from physic_core.discovery.registry import Registry

__all__ = ["ENTRY_POINT_GROUPS", "PLUGINS_GROUP", "core_version", "discover", "required_versions"]

_REQUIREMENT_NAME = re.compile(r"[\w.-]+")


def core_version() -> str:
    """Return the version of the installed physic-core."""
    return version("physic-core")


def required_versions(distribution: str) -> dict[str, str]:
    """Return the installed versions of a distribution's requirements, by name; extras are ignored."""
    found = {}
    with suppress(PackageNotFoundError, ValueError):  # ValueError: the name is empty
        for line in requires(distribution) or ():
            name, marker = _REQUIREMENT_NAME.match(line), line.partition(";")[2]
            if name and "extra" not in marker:
                with suppress(PackageNotFoundError):
                    found[canonicalize_name(name[0])] = version(name[0])
    return found


def discover(
    installed: Iterable[EntryPoint] | None = None,
    *,
    environment: Mapping[str, str] = os.environ,
    clock: Callable[[], float] = time.perf_counter,
) -> Registry:
    """Return a registry of the backends of all installed plugins; it lists broken plugins in ``broken``.

    The arguments are those of :func:`physic_core.discovery.entry_points.find_plugins`.
    """
    found = find_plugins(installed, environment=environment, clock=clock)
    return Registry(
        found.offers, found.broken, restriction=found.restriction, manifests=found.manifests, installed=False
    )
