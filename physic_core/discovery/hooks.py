"""Hooks of plugins: what a plugin adds besides backends.

A plugin with hooks has an entry point in the group ``physic.plugins`` that names a module with
them::

    from physic_core import PluginItem, hookimpl

    @hookimpl
    def physic_commands():
        return [PluginItem("my-command", "my_pkg.commands:my_command", summary="Does ...")]

``physic --help`` imports the module, so it imports nothing slow. What an item names is imported
when it is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal

import pluggy

if TYPE_CHECKING:
    from collections.abc import Mapping

PROJECT = "physic"

hookimpl = pluggy.HookimplMarker(PROJECT)
_hookspec = pluggy.HookspecMarker(PROJECT)


@dataclass(frozen=True)
class PluginItem:
    """A command, an executor, an engine preset, the maker of pictures or a reader of keypoints of a
    plugin.

    Attributes:
        name: of the item; of a command, the words after ``physic``, such as "scene" or "plugins
            check".
        target: "package.module:name" of a function or object, imported when it is used.
        summary: one line for ``--help``.
    """

    name: str
    target: str
    summary: str = ""


@dataclass(frozen=True)
class ExporterRecord:
    """A format of ``physic export``.

    Attributes:
        name: as in ``physic export --to NAME``, lower case with hyphens.
        suffixes: of its files, lower case with the dot, the default first.
        target: "package.module:function" of a function that gets a
            :class:`physic_core.ExportRequest` and returns :class:`physic_core.ExportedFiles`;
            imported when a result is exported.
        audience: programs that read it.
        content: what is in it.
        ups: up axes that it can be written with ("y", "z", "camera"), the default first. The axes
            are described in docs/exports.md.
        stem: file name without suffix, if no path is given; empty for ``name``.
        bodies: "required" for a format that needs at least one person with a body.
        per_person: whether each person is a file of their own.
        needs: what the user must have, or empty.
        packages: import names of required packages, such as those of an extra.
        extra: extra of the distribution that installs ``packages``, or empty.
        options: name of an option -> its values, the default first. A flag has False and True.
    """

    name: str
    suffixes: tuple[str, ...]
    target: str
    audience: str = ""
    content: str = ""
    ups: tuple[str, ...] = ("y",)
    stem: str = ""
    bodies: Literal["optional", "required"] = "optional"
    per_person: bool = False
    needs: str = ""
    packages: tuple[str, ...] = ()
    extra: str = ""
    options: Mapping[str, tuple[str | bool, ...]] = field(default_factory=dict)

    @property
    def missing_packages(self) -> tuple[str, ...]:
        """The required packages that are not installed."""
        return tuple(package for package in self.packages if find_spec(package) is None)


@_hookspec
def physic_commands() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the commands that this plugin adds to ``physic``: each target is a
    ``click.Command``.
    """


@_hookspec
def physic_exporters() -> Sequence[ExporterRecord]:  # type: ignore[empty-body]
    """Return the formats that this plugin adds to ``physic export``."""


@_hookspec
def physic_executors() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the executors that this plugin adds to ``physic batch --executor``.

    Each target is a function that gets :class:`physic_batch.run.ExecutorSettings` and returns
    an :data:`physic_batch.run.Executor`.
    """


@_hookspec
def physic_engine_presets() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the values that this plugin adds to ``engine.preset``.

    Each target is an :class:`physic_core.engine.settings.EngineSettings`.
    """


@_hookspec
def physic_pictures() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the maker of a result's pictures and page
    (:func:`physic_core.pictures.make_pictures`).
    """


@_hookspec
def physic_keypoint_readers() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the readers of other programs' keypoints that this plugin adds to ``--keypoints``.

    Each target is a function that gets a JSON document and the name of the photo's file, and
    returns a :class:`physic_core.types.KeypointTable`, or None if it does not know the form. It
    raises ValueError with what is wrong.
    """


@_hookspec
def physic_body_readers() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the readers of other programs' bodies that this plugin adds to ``--bodies``.

    Each target is a function that gets a :class:`physic_core.types.FileOfPhoto`, and returns
    :class:`physic_core.types.BodiesInFile`, or None if it does not know the form. It raises
    ValueError with what is wrong.
    """


@_hookspec
def physic_mask_readers() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the readers of other programs' masks that this plugin adds to ``--masks``.

    Each target is as of ``physic_body_readers``, and returns
    :class:`physic_core.types.MasksInFile`.
    """


@_hookspec
def physic_body_converters() -> Sequence[PluginItem]:  # type: ignore[empty-body]
    """Return the converter of bodies to other body models.

    The target returns a :class:`physic_core.conversion.BodyConverter` when it is called.
    """


RECORDS: dict[str, type[PluginItem] | type[ExporterRecord]] = {
    "physic_commands": PluginItem,
    "physic_exporters": ExporterRecord,
    "physic_executors": PluginItem,
    "physic_engine_presets": PluginItem,
    "physic_pictures": PluginItem,
    "physic_keypoint_readers": PluginItem,
    "physic_body_readers": PluginItem,
    "physic_mask_readers": PluginItem,
    "physic_body_converters": PluginItem,
}
"""The hooks, and the class of what each returns."""
