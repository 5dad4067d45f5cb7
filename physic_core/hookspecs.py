"""The one hook of a plugin.

A plugin is a distribution with an entry point in the group ``physic.plugins`` that names a module, and that module says
what it offers::

    from physic_core import BackendRecord, hookimpl

    @hookimpl
    def physic_backends():
        return [BackendRecord("metric_depth", "my-depth", "my_pkg.depth:MyDepth", summary="Depth from ...")]

The module holds nothing else and imports nothing heavy: it runs whenever somebody lists the installed backends.
"""

from __future__ import annotations

from collections.abc import Sequence

import pluggy

from physic_core.registry import BackendRecord

__all__ = ["PROJECT", "hookimpl", "physic_backends"]

PROJECT = "physic"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def physic_backends() -> Sequence[BackendRecord]:  # type: ignore[empty-body]
    """Say which backends this plugin offers; called once whenever plugins are discovered."""
