"""Walks the entry points of installed plugins: the only module that knows pluggy.

pluggy's own loader dies with the first broken plugin and does not tell which plugin gave which answer, so we walk the
entry points ourselves: one ``try`` and one plugin manager each, and every record is stamped with who made it.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import Distribution, EntryPoint, distributions, entry_points
from pathlib import Path
from typing import Any, TypeVar

import pluggy

from physic_core.discovery import hookspecs
from physic_core.discovery.error_text import describe
from physic_core.discovery.records import (
    BackendRecord,
    BrokenPlugin,
    Claim,
    CommandRecord,
    InstalledCommand,
    Manifest,
    Origin,
    normal_name,
    problem_of,
)

__all__ = ["GROUP", "Found", "Misplaced", "find", "misplaced"]

GROUP = "physic.plugins"
RESTRICT = "PHYSIC_PLUGINS"
_CORE = re.compile(r"physic[-_.]core(?![\w-])", re.IGNORECASE)
_Record = TypeVar("_Record")
_HOOKS = ("physic_backends", "physic_commands", "physic_weights")
_ENTRY = re.compile(r"[\w.]+\s*(:\s*[\w.]+)?\s*(\[.*\])?")


@dataclass(frozen=True)
class Found:
    """What the installed plugins offer.

    Attributes:
        claims: backends.
        broken: plugins that could not be read, or not as a whole.
        manifests: lists of weights, unread.
        commands: subcommands of ``physic``.
        restriction: value of ``PHYSIC_PLUGINS`` that hid the rest, None where nothing did.
    """

    claims: tuple[Claim, ...] = ()
    broken: tuple[BrokenPlugin, ...] = ()
    manifests: tuple[Manifest, ...] = ()
    commands: tuple[InstalledCommand, ...] = ()
    restriction: str | None = None


@dataclass(frozen=True)
class Misplaced:
    """A distribution that looks like a plugin, and is none as it is installed.

    Attributes:
        origin: which one.
        cause: what is wrong and what to do, in one line.
        group: of its entry points; empty where it has none that is nearly ours.
    """

    origin: Origin
    cause: str
    group: str = ""


def find(
    installed: Iterable[EntryPoint] | None = None,
    *,
    environment: Mapping[str, str] = os.environ,
    clock: Callable[[], float] = time.perf_counter,
) -> Found:
    """Ask every installed plugin what it offers; a broken one becomes a row, never an error.

    Args:
        installed: entry points; None for those of this Python.
        environment: ``PHYSIC_PLUGINS=a,b`` in it leaves only the distributions or entry points of these names, empty
            leaves none, and the others are not even imported.
        clock: seconds.
    """
    found = list(entry_points(group=GROUP) if installed is None else installed)
    restriction = environment.get(RESTRICT)
    claims: list[Claim] = []
    broken: list[BrokenPlugin] = []
    manifests: list[Manifest] = []
    commands: list[InstalledCommand] = []
    if restriction is not None:
        found, broken = _restrict(found, restriction)
    for entry in sorted(found, key=lambda e: (_distribution(e)[0], e.name)):
        start = clock()
        try:
            # What a plugin prints is not what a command answers.
            with redirect_stdout(sys.stderr):
                manager = _load(entry)
                records = _records(manager, entry, "physic_backends", BackendRecord)
                added = _records(manager, entry, "physic_commands", CommandRecord)
                weights, complaints = _ask_for_weights(manager, entry)
            origin = _origin(entry, clock() - start)
            claims += [Claim(record, origin, problem_of(record, origin)) for record in records]
            manifests += [Manifest(origin, path) for path in weights]
            commands += [InstalledCommand(record, origin) for record in added]
            broken += [BrokenPlugin(origin, *complaint) for complaint in complaints]
        # SystemExit too: a plugin that calls sys.exit() at import must not take `physic plugins` with it.
        except (Exception, SystemExit) as error:
            cause = str(error) if isinstance(error, _BadPlugin) else describe(error, _module(entry))
            broken.append(BrokenPlugin(_origin(entry), cause, error))
    return Found(tuple(claims), tuple(broken), tuple(manifests), tuple(commands), restriction)


def misplaced(
    installed: Iterable[Distribution] | None = None, *, environment: Mapping[str, str] = os.environ
) -> tuple[Misplaced, ...]:
    """Installed distributions that look like plugins, and that :func:`find` cannot see.

    Their entry points are in a group that is called nearly like ours, or they are called physic-... and have none.

    Args:
        installed: distributions; None for those of this Python.
        environment: as for :func:`find`.
    """
    wanted = _wanted(environment.get(RESTRICT))
    known: dict[str, Misplaced | None] = {}
    for found in distributions() if installed is None else installed:
        name = found.metadata["Name"] or ""
        key = normal_name(name)
        # The first of a name is the one that Python imports.
        if name and key not in known and key != "physic-core" and (wanted is None or key in wanted):
            known[key] = _misplaced(found, name)
    return tuple(row for _, row in sorted(known.items()) if row is not None)


def _misplaced(found: Distribution, name: str) -> Misplaced | None:
    groups = sorted({entry.group for entry in found.entry_points})
    if GROUP in groups:
        return None
    origin = Origin("", name, found.metadata["Version"] or "")
    cure = f'write [project.entry-points."{GROUP}"] in its pyproject.toml, and install it again'
    uses_core = any(_CORE.match(line) for line in found.requires or ())
    for group in groups:
        ours = "physic" in re.split(r"[^a-z0-9]+", group.lower())
        if ours or (uses_core and get_close_matches(group, [GROUP], cutoff=0.8)):
            said = f"its entry points are in the group '{group}', which is not read: {cure}"
            return Misplaced(origin, said, group)
    if normal_name(name).startswith("physic-"):
        said = f"it has no entry point in the group '{GROUP}', so that no backend of it is found: {cure}"
        return Misplaced(origin, said)
    return None


class _BadPlugin(Exception):
    """A plugin that loads but does not do what a plugin does."""

    def __init__(self, message: str) -> None:
        super().__init__(message)


def _load(entry: EntryPoint) -> pluggy.PluginManager:
    """Import one plugin, and see that its hooks are ours."""
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    if not _ENTRY.fullmatch(entry.value.strip()):
        raise _BadPlugin(
            f"its entry point '{entry.name} = {entry.value}' should name a module: '{entry.name} = my_pkg'"
        )
    module = entry.load()
    manager.register(module, name=entry.name)
    try:
        manager.check_pending()
    except pluggy.PluginValidationError as error:
        unknown = [n for n, h in vars(manager.hook).items() if not n.startswith("_") and not h.has_spec()]
        raise _BadPlugin(
            f"there is no hook named {unknown[0]!r}; there are {', '.join(repr(name) for name in _HOOKS)}"
        ) from error
    if not any(getattr(manager.hook, hook).get_hookimpls() for hook in _HOOKS):
        raise _BadPlugin(f"{entry.value} has no function physic_backends marked with @hookimpl")
    return manager


def _records(manager: pluggy.PluginManager, entry: EntryPoint, hook: str, kind: type[_Record]) -> list[_Record]:
    """Call a hook of one plugin that returns a list of records."""
    records: list[_Record] = []
    for implementation in getattr(manager.hook, hook).get_hookimpls():
        returned: Any = implementation.function()
        if not isinstance(returned, (list, tuple)) or not all(isinstance(r, kind) for r in returned):
            raise _BadPlugin(f"{hook}() must return a list of {kind.__name__}, got {_describe(returned, kind)}")
        records += returned
    return records


def _ask_for_weights(
    manager: pluggy.PluginManager, entry: EntryPoint
) -> tuple[list[Path], list[tuple[str, BaseException | None]]]:
    """The lists of weights of one plugin, unread, and complaints: what is wrong with them takes no backend away."""
    paths: list[Path] = []
    complaints: list[tuple[str, BaseException | None]] = []
    for implementation in manager.hook.physic_weights.get_hookimpls():
        try:
            answer: Any = implementation.function()
        except (Exception, SystemExit) as error:
            complaints.append((f"physic_weights() fails: {describe(error, _module(entry))}", error))
            continue
        if not isinstance(answer, (str, os.PathLike)):
            kind = type(answer).__name__
            complaints.append((f"physic_weights() must return the path of a TOML file or folder, got {kind}", None))
        elif not os.path.exists(answer):
            complaints.append((f"physic_weights() names {os.fspath(answer)}, which is not there", None))
        else:
            paths.append(Path(answer))
    return paths, complaints


def _describe(answer: object, kind: type) -> str:
    if isinstance(answer, (list, tuple)):
        strangers = sorted({type(r).__name__ for r in answer if not isinstance(r, kind)})
        return f"a {type(answer).__name__} with {', '.join(strangers)} in it"
    return type(answer).__name__


def _wanted(restriction: str | None) -> dict[str, str] | None:
    """What ``PHYSIC_PLUGINS`` names, by normal name; None where it is not set."""
    if restriction is None:
        return None
    return {normal_name(n.strip()): n.strip() for n in restriction.split(",") if n.strip()}


def _restrict(found: list[EntryPoint], wanted: str) -> tuple[list[EntryPoint], list[BrokenPlugin]]:
    """Leave the named plugins; a name that fits none becomes a row, or a typing error would look like a lost plugin."""
    names = _wanted(wanted) or {}
    kept, fitting = [], set()
    for entry in found:
        own = {normal_name(n) for n in (entry.name, _module(entry), _distribution(entry)[0])}
        if own & names.keys():
            kept.append(entry)
            fitting |= own
    lost = [text for name, text in names.items() if name not in fitting]
    return kept, [BrokenPlugin(Origin("", text), f"named in {RESTRICT} but not installed") for text in lost]


def _origin(entry: EntryPoint, seconds: float = 0.0) -> Origin:
    distribution, number = _distribution(entry)
    return Origin(_module(entry), distribution, number, seconds)


def _module(entry: EntryPoint) -> str:
    """Its module, or what stands in its place."""
    return entry.value.partition(":")[0].strip()


def _distribution(entry: EntryPoint) -> tuple[str, str]:
    """Name and version; an entry point made by hand has no distribution, and a damaged one no name."""
    found = entry.dist.metadata if entry.dist is not None else None
    if found is None or not found["Name"]:
        return entry.name, ""
    return found["Name"], found["Version"] or ""
