"""Hints in messages: the known distributions and what they offer, how to install them, and names that are close."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any

_IN_CONTRIB = ("physic-omnieraser", "physic-ray")


def _read() -> dict[str, Any]:
    return tomllib.loads((resources.files(__package__) / "catalog.toml").read_text(encoding="utf-8"))


def _by_distribution(tables: Mapping[str, Mapping[str, list[str]]]) -> dict[str, dict[str, tuple[str, ...]]]:
    return {owner: {name: tuple(words) for name, words in table.items()} for owner, table in tables.items()}


def _owners(offers: Mapping[str, Iterable[str]]) -> dict[str, str]:
    return {name: distribution for distribution, names in offers.items() for name in names}


_TABLES = _read()

REQUIRES: dict[str, list[str]] = _TABLES["requires"]
"""Distributions of the project that another one needs beside physic-core."""

CATALOG = _by_distribution(_TABLES["backends"])
"""Backend names by distribution and interface."""

COMMANDS = _owners(_TABLES["commands"])
"""Distribution of each known plugin command of ``physic``."""

ENERGIES = _owners(_TABLES["energies"])
"""Distribution of each known preset of the engine."""

PAGES = _owners(_TABLES["pages"])
"""Distribution of each known maker of pages of results."""

EXECUTORS = _owners(_TABLES["executors"])
"""Distribution of each known executor of ``physic batch``."""

EXPORTERS = _by_distribution(_TABLES["exporters"])
"""Export formats and their suffixes, by distribution."""


def distribution_for(interface: str | None, name: str) -> str | None:
    """Return the known distribution that offers a backend, or None; ``interface`` None means any interface."""
    return next((owner for owner, offers in CATALOG.items() if name in _names(offers, interface)), None)


def known_names(interface: str | None) -> tuple[str, ...]:
    """Return the backend names that known distributions offer for an interface, or for all interfaces if it is None."""
    return tuple(dict.fromkeys(name for offers in CATALOG.values() for name in _names(offers, interface)))


def _names(offers: Mapping[str, tuple[str, ...]], interface: str | None) -> tuple[str, ...]:
    if interface is not None:
        return offers.get(interface, ())
    return tuple(name for names in offers.values() for name in names)


def sources_in_checkout(distribution: str) -> tuple[str, ...]:
    """Return the folders of a checkout that install a distribution of this project; empty for another one.

    They include the distributions that it requires: until they are released, no index may be asked for their names.
    """
    owners = (COMMANDS, ENERGIES, EXECUTORS, PAGES)
    if distribution not in {*CATALOG, *EXPORTERS, *(name for table in owners for name in table.values())}:
        return ()
    names = (*REQUIRES.get(distribution, ()), distribution)
    return tuple(f"{'contrib' if name in _IN_CONTRIB else 'plugins'}/{name}" for name in names)


def how_to_install(distribution: str, extra: str = "") -> str:
    """Return the install command of a distribution; distributions of this project are installed from a checkout."""
    *others, source = sources_in_checkout(distribution) or (distribution,)
    if extra:
        source = f"'{source}[{extra}]'"
    if not sources_in_checkout(distribution):
        return f"`pip install {source}`"
    return f"`pip install {' '.join(f'-e {each}' for each in (*others, source))}` in a checkout of PhySIC"
