"""Read entry points of installed distributions without importing their targets, and versions of
distributions.

A plugin has one entry point for each backend, in the group ``physic.INTERFACE``, such as
``physic.metric_depth``. It has one in ``physic.weights`` if it lists weights
(:mod:`physic_core.weights.manifest`), and one in ``physic.plugins`` if it has hooks
(:mod:`physic_core.discovery.hooks`).
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import (
    PackageNotFoundError,
    distribution,
    distributions,
    packages_distributions,
    requires,
    version,
)
from importlib.util import find_spec
from pathlib import Path

from physic_core.errors import PluginError

HOOKS_GROUP = "physic.plugins"
WEIGHTS_GROUP = "physic.weights"
PLUGINS_VARIABLE = "PHYSIC_PLUGINS"
_PREFIX = "physic."
_GROUP = re.compile(r"physic(?![a-z])")  # also "physic_plugins", which is reported
_REQUIREMENT_NAME = re.compile(r"[\w.-]+")


@dataclass(frozen=True)
class Offer:
    """One entry point of an installed distribution, or a class that stands in for one.

    Attributes:
        group: "physic.metric_depth" for a backend of the interface "metric_depth".
        name: the entry point's; of a backend, its name in configs.
        target: "package.module:Class"; for a class in a file of the user, "/folder/module:Class".
        distribution: its name, or words that say where the class comes from.
        version: of the distribution; "" if there is none.
    """

    group: str
    name: str
    target: str
    distribution: str
    version: str = ""

    @property
    def interface(self) -> str:
        """The interface of a backend."""
        return self.group.removeprefix(_PREFIX)

    @property
    def owner(self) -> str:
        """Distribution and version."""
        return f"{self.distribution} {self.version}".rstrip()

    def __str__(self) -> str:
        return f"{self.interface} '{self.name}' ({self.owner})"


def installed_offers(group: str = "") -> tuple[Offer, ...]:
    """Return the entry points of a group, or of all groups of PhySIC, sorted by group, name and
    distribution.

    With ``PHYSIC_PLUGINS=a,b`` in the environment, only those of the distributions with these
    names.
    """
    asked = restricted_to()
    offers = _read_entry_points(_import_folders())
    return tuple(
        offer
        for offer in offers
        if group in ("", offer.group)
        and (asked is None or canonicalize_name(offer.distribution) in asked)
    )


def restricted_to() -> tuple[str, ...] | None:
    """Return the names of the distributions that ``PHYSIC_PLUGINS`` allows; None if it is not
    set.
    """
    text = os.environ.get(PLUGINS_VARIABLE)
    return (
        None
        if text is None
        else tuple(canonicalize_name(name.strip()) for name in text.split(",") if name.strip())
    )


def group_problem(group: str) -> str:
    """Return why nothing reads a group of entry points; "" if it is read."""
    from physic_core.discovery.error_text import did_you_mean
    from physic_core.interfaces import INTERFACES

    groups = (HOOKS_GROUP, WEIGHTS_GROUP, *(f"{_PREFIX}{interface}" for interface in INTERFACES))
    return (
        ""
        if group in groups
        else f"nothing reads its entry points of the group '{group}'{did_you_mean(group, groups)}"
    )


def weights_folder(offer: Offer) -> Path:
    """Return the folder of the package that an entry point of ``physic.weights`` names; the package
    is not imported.

    Raises:
        PluginError: the folder does not exist.
    """
    top, *below = offer.target.split(".")
    with suppress(ImportError, ValueError):
        spec = find_spec(top)
        for place in (spec and spec.submodule_search_locations) or ():
            if (folder := Path(place, *below)).is_dir():
                return folder
    raise PluginError(
        f"{offer.owner}: there is no folder of the package {offer.target}, which should list its "
        f"weights"
    )


def canonicalize_name(distribution: str) -> str:
    """Return a distribution name in lower case, with hyphens, for comparison (PEP 503)."""
    return re.sub(r"[-_.]+", "-", distribution).lower()


def core_version() -> str:
    """Return the version of the installed metricbody."""
    return version("metricbody")


def distributions_of(package: str) -> list[str]:
    """Return the names of the installed distributions that have a top-level package."""
    return _owners(_import_folders()).get(package, [])


def versions_of(package: str) -> list[str]:
    """Return the versions of the installed distributions that have a top-level package, with a
    digest of the files of those that do not come from an index.
    """
    return list(_versions_of(package, _import_folders()))


@lru_cache(maxsize=1024)
def _versions_of(package: str, folders: tuple[tuple[str, float], ...]) -> tuple[str, ...]:
    try:
        return (_version_and_files(package),)
    except PackageNotFoundError:  # a package with another name than its distribution
        return tuple(map(_version_and_files, _owners(folders).get(package, ())))


def _version_and_files(name: str) -> str:
    """Return the version of a distribution, and a digest of the files of one that does not come
    from an index: its author may change them and keep the version.
    """
    found = distribution(name)
    if found.read_text("direct_url.json") is None:
        return found.version
    listed = (found.read_text("RECORD") or "").splitlines()
    files = sorted(one for one in listed if ",sha256=" in one and ".dist-info/" not in one)
    return f"{found.version} {hashlib.sha256(repr(files).encode()).hexdigest()}"


def required_versions(distribution: str) -> dict[str, str]:
    """Return the installed versions of a distribution's requirements by name, as
    :func:`versions_of`; extras are ignored.
    """
    return dict(_read_versions(distribution, _import_folders()))


@lru_cache(maxsize=64)
def _read_versions(
    distribution: str, folders: tuple[tuple[str, float], ...]
) -> tuple[tuple[str, str], ...]:
    versions = {}
    with suppress(PackageNotFoundError, ValueError):  # ValueError: the name is empty
        for line in requires(distribution) or ():
            name = _REQUIREMENT_NAME.match(line)
            marker = line.partition(";")[2]
            if name and "extra" not in marker:
                with suppress(PackageNotFoundError):
                    versions[canonicalize_name(name[0])] = _version_and_files(name[0])
    return tuple(versions.items())


def _import_folders() -> tuple[tuple[str, float], ...]:
    """Return the folders that distributions are searched in, and when each was changed."""
    return tuple((folder, os.stat(folder).st_mtime) for folder in sys.path if os.path.isdir(folder))


@lru_cache(maxsize=8)
def _owners(folders: tuple[tuple[str, float], ...]) -> Mapping[str, list[str]]:
    return packages_distributions()


@lru_cache(maxsize=8)
def _read_entry_points(folders: tuple[tuple[str, float], ...]) -> tuple[Offer, ...]:
    offers = []
    distributions_read = set()
    for installed in distributions():
        try:
            entries = [entry for entry in installed.entry_points if _GROUP.match(entry.group)]
        except ValueError:  # not UTF-8: it is no plugin that could be named
            continue
        if not entries:
            continue
        metadata = installed.metadata  # parsed at each access
        name = metadata["Name"]
        # Python imports the first distribution of a name
        if not name or canonicalize_name(name) in distributions_read:
            continue
        distributions_read.add(canonicalize_name(name))
        offers += [
            Offer(one.group, one.name, one.value, name, metadata["Version"]) for one in entries
        ]
    return tuple(sorted(offers, key=lambda one: (one.group, one.name, one.distribution)))
