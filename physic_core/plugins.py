"""Finds installed plugins: the only module that knows pluggy and entry points.

pluggy's own loader dies with the first broken plugin and does not tell which plugin gave which answer, so we walk the
entry points ourselves: one ``try`` and one plugin manager each, and every record is stamped with who made it.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stdout, suppress
from difflib import get_close_matches
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, requires, version
from pathlib import Path
from typing import Any

import pluggy

from physic_core import hookspecs
from physic_core.registry import (
    PLUGIN_API,
    TARGET,
    BackendRecord,
    BrokenPlugin,
    Claim,
    Manifest,
    Origin,
    Registry,
    normal_name,
)

__all__ = ["GROUP", "core_version", "discover", "required_versions"]

GROUP = "physic.plugins"
RESTRICT = "PHYSIC_PLUGINS"
_ENTRY = re.compile(r"[\w.]+\s*(:\s*[\w.]+)?\s*(\[.*\])?")
_NAME = re.compile(r"[a-z0-9]+([.-][a-z0-9]+)*")
_NEEDED = re.compile(r"[\w.-]+")
_RESERVED = ("none",)


def core_version() -> str:
    """Version of the installed physic-core."""
    return version("physic-core")


def required_versions(distribution: str) -> dict[str, str]:
    """Versions of what a distribution requires, its extras aside, by normal name; nothing where it is not installed."""
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
    if restriction is not None:
        found, broken = _restrict(found, restriction)
    for entry in sorted(found, key=lambda e: (_distribution(e)[0], e.name)):
        start = clock()
        try:
            # What a plugin prints is not what a command answers.
            with redirect_stdout(sys.stderr):
                manager = _load(entry)
                records = _ask(manager, entry)
                weights, complaints = _ask_for_weights(manager)
            origin = _origin(entry, clock() - start)
            claims += [Claim(record, origin, _problem(record, origin)) for record in records]
            manifests += [Manifest(origin, path) for path in weights]
            broken += [BrokenPlugin(origin, *complaint) for complaint in complaints]
        # SystemExit too: a plugin that calls sys.exit() at import must not take `physic plugins` with it.
        except (Exception, SystemExit) as error:
            cause = str(error) if isinstance(error, _BadPlugin) else f"{type(error).__name__}: {error}"
            broken.append(BrokenPlugin(_origin(entry), cause, error))
    return Registry(claims, broken, restriction=restriction, manifests=manifests)


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
            f"there is no hook named {unknown[0]!r}; there are 'physic_backends' and 'physic_weights'"
        ) from error
    return manager


def _ask(manager: pluggy.PluginManager, entry: EntryPoint) -> list[BackendRecord]:
    """Call the hook of one plugin that says which backends it offers."""
    hook = manager.hook.physic_backends
    if not hook.get_hookimpls():
        raise _BadPlugin(f"{entry.value} has no function physic_backends marked with @hookimpl")
    records: list[BackendRecord] = []
    for implementation in hook.get_hookimpls():
        answer: Any = implementation.function()
        if not isinstance(answer, (list, tuple)) or not all(isinstance(r, BackendRecord) for r in answer):
            raise _BadPlugin(f"physic_backends() must return a list of BackendRecord, got {_describe(answer)}")
        records += answer
    return records


def _ask_for_weights(
    manager: pluggy.PluginManager,
) -> tuple[list[Path], list[tuple[str, BaseException | None]]]:
    """The lists of weights of one plugin, unread, and complaints: what is wrong with them takes no backend away."""
    paths: list[Path] = []
    complaints: list[tuple[str, BaseException | None]] = []
    for implementation in manager.hook.physic_weights.get_hookimpls():
        try:
            answer: Any = implementation.function()
        except (Exception, SystemExit) as error:
            complaints.append((f"physic_weights() fails: {type(error).__name__}: {error}", error))
            continue
        if not isinstance(answer, (str, os.PathLike)):
            kind = type(answer).__name__
            complaints.append((f"physic_weights() must return the path of a TOML file or folder, got {kind}", None))
        elif not os.path.exists(answer):
            complaints.append((f"physic_weights() names {os.fspath(answer)}, which is not there", None))
        else:
            paths.append(Path(answer))
    return paths, complaints


def _describe(answer: object) -> str:
    if isinstance(answer, (list, tuple)):
        strangers = sorted({type(r).__name__ for r in answer if not isinstance(r, BackendRecord)})
        return f"a {type(answer).__name__} with {', '.join(strangers)} in it"
    return type(answer).__name__


def _problem(record: BackendRecord, origin: Origin) -> str:
    """What speaks against using a record as it stands."""
    from physic_core.interfaces import INTERFACES

    if record.interface not in INTERFACES:
        close = get_close_matches(str(record.interface), INTERFACES, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(INTERFACES)}"
        return f"no interface named '{record.interface}'; {hint}"
    if not isinstance(record.name, str) or not _NAME.fullmatch(record.name) or record.name in _RESERVED:
        return f"its name should be of a-z, 0-9 and hyphens, and not 'none', got {record.name!r}"
    if isinstance(record.target, str) and not TARGET.fullmatch(record.target):
        return f"its target should be 'package.module:Class', got {record.target!r}"
    if not isinstance(record.api, int):
        return f"its plugin API should be a whole number such as {PLUGIN_API}, got {record.api!r}"
    if record.api > PLUGIN_API:
        return f"needs plugin API {record.api}, this physic-core has {PLUGIN_API}: upgrade physic-core"
    if record.api < PLUGIN_API:
        return f"written for plugin API {record.api}, this physic-core has {PLUGIN_API}: upgrade {origin.distribution}"
    return ""


def _restrict(found: list[EntryPoint], wanted: str) -> tuple[list[EntryPoint], list[BrokenPlugin]]:
    """Leave the named plugins; a name that fits none becomes a row, or a typing error would look like a lost plugin."""
    names = {normal_name(n.strip()): n.strip() for n in wanted.split(",") if n.strip()}
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
