"""Hooks that a plugin may implement: they return its backends, weight manifests, commands and exporters.

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

A plugin adds a format of ``physic export`` with a function, which is imported when a result is exported. The function
gets an :class:`physic_core.ExportRequest` and returns :class:`physic_core.ExportedFiles`::

    @hookimpl
    def physic_exporters():
        return [ExporterRecord("my-format", (".my",), "my_pkg.export:export_my_format", audience="My program")]

What else a plugin adds needs no hook. It is an entry point, whose value is imported when it is used:

- ``physic.energies``: its name is a value of ``engine.preset``, and its value an
  :class:`physic_core.engine.settings.EngineSettings`.
- ``physic.executors``: its name is a value of ``physic batch --executor``, and its value a function that gets
  :class:`physic_core.batch.executors.ExecutorSettings` and returns an :data:`physic_core.batch.run.Executor`.
- ``physic.pages``: its value is a function that makes ``report.html``, the page of a result
  (:func:`physic_core.visual.report.report_html`).

As in ``pyproject.toml``::

    [project.entry-points."physic.energies"]
    my-energy = "my_pkg.presets:MY_ENERGY"
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from physic_core.discovery.records import BackendRecord, CommandRecord, ExporterRecord

PROJECT = "physic"

_hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@_hookspec
def physic_backends() -> Sequence[BackendRecord]:  # type: ignore[empty-body]
    """Return the backends of this plugin; called once per discovery."""


@_hookspec
def physic_commands() -> Sequence[CommandRecord]:  # type: ignore[empty-body]
    """Return the commands that this plugin adds to ``physic``."""


@_hookspec
def physic_exporters() -> Sequence[ExporterRecord]:  # type: ignore[empty-body]
    """Return the formats that this plugin adds to ``physic export``."""


@_hookspec
def physic_weights() -> Path:  # type: ignore[empty-body]
    """Return the path of this plugin's weight manifest: a TOML file, or a folder of them."""
