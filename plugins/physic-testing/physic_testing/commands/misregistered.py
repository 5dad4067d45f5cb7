"""Find distributions that look like plugins, but have no entry point in a group that is read."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.metadata import Distribution, distributions  # noqa: TID251 -- those that registered nothing, too

from physic_core.discovery.plugins import ENTRY_POINT_GROUPS, PLUGINS_GROUP
from physic_core.discovery.registry import Origin, canonicalize_name

_CORE = re.compile(r"physic[-_.]core(?![\w-])", re.IGNORECASE)


@dataclass(frozen=True)
class MisregisteredPlugin:
    """A distribution that looks like a plugin, but has no entry point in a group that is read.

    Attributes:
        origin: the distribution.
        cause: the error and its remedy, one line.
        group: group of its entry points, if the name is similar to one that is read; else empty.
    """

    origin: Origin
    cause: str
    group: str = ""


def find_misregistered(
    installed: Iterable[Distribution] | None = None, *, restriction: str | None = None
) -> tuple[MisregisteredPlugin, ...]:
    """List distributions that look like plugins, but whose backends :func:`physic_core.discover` does not find.

    Their entry points are in a group with a similar name, or they are called physic-... and have no entry point.

    Args:
        installed: distributions; None for those of this Python.
        restriction: value of ``PHYSIC_PLUGINS``, which hides all other plugins; None if it is not set.
    """
    wanted = None if restriction is None else {canonicalize_name(name.strip()) for name in restriction.split(",")}
    known: dict[str, MisregisteredPlugin | None] = {}
    for found in distributions() if installed is None else installed:
        name = found.metadata["Name"] or ""
        key = canonicalize_name(name)
        # Python imports the first distribution of a name.
        if name and key not in known and key != "physic-core" and (wanted is None or key in wanted):
            known[key] = _misregistered(found, name)
    return tuple(row for _, row in sorted(known.items()) if row is not None)


def _is_named_ours(group: str) -> bool:
    return "physic" in re.split(r"[^a-z0-9]+", group.lower())


def _is_close(group: str) -> bool:
    return bool(get_close_matches(group, ENTRY_POINT_GROUPS, cutoff=0.8))


def _misregistered(found: Distribution, name: str) -> MisregisteredPlugin | None:
    groups = sorted({entry.group for entry in found.entry_points})
    if not set(ENTRY_POINT_GROUPS).isdisjoint(groups):
        return None
    origin = Origin("", name, found.metadata["Version"] or "")
    cure = f'write [project.entry-points."{PLUGINS_GROUP}"] in its pyproject.toml, and install it again'
    # A plugin need not require the core while that has no release.
    is_ours = name_is_ours = canonicalize_name(name).startswith("physic-")
    is_ours |= any(_CORE.match(line) for line in found.requires or ())
    for group in groups:
        if _is_named_ours(group) or (is_ours and _is_close(group)):
            return MisregisteredPlugin(
                origin, f"its entry points are in the group '{group}', which is not read: {cure}", group
            )
    if name_is_ours:
        return MisregisteredPlugin(
            origin, f"it has no entry point in the group '{PLUGINS_GROUP}', so that no backend of it is found: {cure}"
        )
    return None
