"""The distributions of the project and what they add, for hints on what to install."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from importlib import resources
from typing import Any

_IN_CONTRIB = ("metricbody-omnieraser", "metricbody-ray")
_TABLES: dict[str, Any] = tomllib.loads(
    (resources.files(__package__) / "catalog.toml").read_text(encoding="utf-8")
)

REQUIRES: dict[str, list[str]] = _TABLES["requires"]
"""Distributions of the project that another one needs beside metricbody."""


def _owners(table: str) -> dict[str, str]:
    return {name: distribution for distribution, names in _TABLES[table].items() for name in names}


BACKENDS = _owners("backends")
"""Distribution of each known backend."""

PACKAGES = _owners("packages")
"""Distribution of each top-level package of the project that has backends."""

COMMANDS = _owners("commands")
"""Distribution of each known plugin command of ``physic``."""

ENGINE_PRESETS = _owners("engine_presets")
"""Distribution of each known preset of the engine."""

EXECUTORS = _owners("executors")
"""Distribution of each known executor of ``physic batch``."""

(FORMATS,) = _TABLES["exporters"]
"""Distribution with the formats of ``physic export``."""


def sources_in_checkout(distribution: str) -> tuple[str, ...]:
    """Return the folders of a checkout that install a distribution of this project; empty for
    another one.

    They include the distributions that it requires: until they are released, no index may be asked
    for their names.
    """
    if not any(distribution in table for table in _TABLES.values()):
        return ()
    names = dict.fromkeys(_with_required(distribution))
    return tuple(
        f"{'contrib' if name in _IN_CONTRIB else 'plugins'}/{name.removeprefix('metricbody-')}"
        for name in names
    )


def _with_required(distribution: str) -> Iterator[str]:
    """Yield what a distribution requires, and itself."""
    for other in REQUIRES.get(distribution, ()):
        yield from _with_required(other)
    yield distribution


def how_to_install(distribution: str, extra: str = "") -> str:
    """Return the install command of a distribution; distributions of this project are installed
    from a checkout.
    """
    *others, source = sources_in_checkout(distribution) or (distribution,)
    if extra:
        source = f"'{source}[{extra}]'"
    if not sources_in_checkout(distribution):
        return f"`pip install {source}`"
    return (
        f"`pip install {' '.join(f'-e {each}' for each in (*others, source))}` in a checkout "
        f"of PhySIC"
    )
