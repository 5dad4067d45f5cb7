"""Hooks that a plugin may implement: they return its backends, weight manifests, commands, exporters and the like.

A plugin is a distribution with an entry point in the group ``physic.plugins`` that names a module. The
hooks of that module return its backends::

    from physic_core import BackendRecord, hookimpl

    @hookimpl
    def physic_backends():
        return [BackendRecord("metric_depth", "my-depth", "my_pkg.depth:MyDepth", api=1, summary="Depth from ...")]

The module imports nothing slow: it is imported whenever installed backends are listed.

A plugin whose weights are not inside its wheel lists them in TOML files (:mod:`physic_core.weights.manifest`), and
returns their folder::

    @hookimpl
    def physic_weights():
        return Path(__file__).parent / "weights"

A plugin adds a subcommand to ``physic`` with a ``click.Command``, which is imported when the command runs::

    @hookimpl
    def physic_commands():
        return [CommandRecord("my-command", "my_pkg.commands:my_command", summary="Does ...")]

A plugin adds a preset of the engine with an :class:`physic_core.engine.settings.EngineSettings`, which is imported when
the preset is used::

    @hookimpl
    def physic_energies():
        return [EnergyRecord("my-energy", "my_pkg.presets:MY_ENERGY", summary="Minimises ...")]

A plugin adds a value of ``physic batch --executor`` with a function, which is imported when it is used::

    @hookimpl
    def physic_executors():
        return [ExecutorRecord("my-cluster", "my_pkg.cluster:my_executor", summary="Runs on ...")]

A plugin adds a format of ``physic export`` with a function, which is imported when a result is exported. The function
gets an :class:`physic_core.ExportRequest` and returns :class:`physic_core.ExportedFiles`::

    @hookimpl
    def physic_exporters():
        return [ExporterRecord("my-format", (".my",), "my_pkg.export:export_my_format", audience="My program")]

A plugin joins the results of photos of one moment to one, for ``physic batch``, with a function, which is imported when
a table has such photos::

    @hookimpl
    def physic_moments():
        return [MomentRecord("my-moments", "my_pkg.moments:join", summary="Matches ...")]

A plugin makes ``report.html``, the page of a result, with a function, which is imported when a page is written::

    @hookimpl
    def physic_reports():
        return [ReportRecord("my-page", "my_pkg.page:my_page", summary="Shows ...")]
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from physic_core.discovery.records import (
        BackendRecord,
        CommandRecord,
        EnergyRecord,
        ExecutorRecord,
        ExporterRecord,
        MomentRecord,
        ReportRecord,
    )

__all__ = [
    "PROJECT",
    "hookimpl",
    "physic_backends",
    "physic_commands",
    "physic_energies",
    "physic_executors",
    "physic_exporters",
    "physic_moments",
    "physic_reports",
    "physic_weights",
]

PROJECT = "physic"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def physic_backends() -> Sequence[BackendRecord]:  # type: ignore[empty-body]
    """Return the backends of this plugin; called once per discovery."""


@hookspec
def physic_commands() -> Sequence[CommandRecord]:  # type: ignore[empty-body]
    """Return the commands that this plugin adds to ``physic``."""


@hookspec
def physic_energies() -> Sequence[EnergyRecord]:  # type: ignore[empty-body]
    """Return the presets of the engine that this plugin adds."""


@hookspec
def physic_executors() -> Sequence[ExecutorRecord]:  # type: ignore[empty-body]
    """Return the executors that this plugin adds to ``physic batch``."""


@hookspec
def physic_exporters() -> Sequence[ExporterRecord]:  # type: ignore[empty-body]
    """Return the formats that this plugin adds to ``physic export``."""


@hookspec
def physic_moments() -> Sequence[MomentRecord]:  # type: ignore[empty-body]
    """Return how this plugin joins photos of one moment."""


@hookspec
def physic_reports() -> Sequence[ReportRecord]:  # type: ignore[empty-body]
    """Return the page of a result that this plugin makes."""


@hookspec
def physic_weights() -> Path:  # type: ignore[empty-body]
    """Return the path of this plugin's weight manifest: a TOML file, or a folder of them."""
