"""Records of backends, commands, energies, executors, exporters, moments and pages, which plugin hooks return."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.interfaces import Backend

__all__ = [
    "RECORD_HOOKS",
    "BackendRecord",
    "CommandRecord",
    "EnergyRecord",
    "ExecutorRecord",
    "ExporterRecord",
    "MomentRecord",
    "ReportRecord",
]


@dataclass(frozen=True)
class BackendRecord:
    """Name, class, interface and requirements of one backend of a plugin.

    Attributes:
        interface: "segmenter", "inpainter", "metric_depth", "relative_pointmap", "keypoint_detector", "body_estimator",
            "hand_estimator" or "contact_prior".
        name: the backend's name in configs, lower case with hyphens.
        target: "package.module:Class", imported when the backend is first used. In a registry built by hand, it may
            be the class itself.
        api: version of the interface that the backend implements, such as 1; a core with another version refuses it.
        summary: one line for ``physic plugins``.
        weights_license: licence of the weights; empty without weights.
        needs: further requirements, one word or phrase each ("GPU", "a checkpoint file").
        homepage: URL of its documentation.
        packages: import names of required packages, such as those of an extra.
        weights: names of the weight sets that it reads by default; ``physic plugins`` checks that they are present.
    """

    interface: str
    name: str
    target: str | type[Backend]
    api: int
    summary: str = ""
    weights_license: str = ""
    needs: tuple[str, ...] = ()
    homepage: str = ""
    packages: tuple[str, ...] = ()
    weights: tuple[str, ...] = ()


@dataclass(frozen=True)
class _TargetRecord:
    """What a plugin adds by a function or an object of its own.

    Attributes:
        name: of what is added.
        target: "package.module:name" of the function or object, imported when it is used.
        summary: one line for ``--help`` and messages.
    """

    name: str
    target: str
    summary: str = ""


class CommandRecord(_TargetRecord):
    """A command that a plugin adds to ``physic``; its name is the words after it, such as "bench" or "plugins check".

    The target is a ``click.Command``.
    """


class EnergyRecord(_TargetRecord):
    """A preset of the engine; its name is the value of ``engine.preset``, in lower case with hyphens.

    The target is a :class:`physic_core.engine.settings.EngineSettings`.
    """


class ExecutorRecord(_TargetRecord):
    """A way to run ``physic batch``, such as on a cluster; its name is the value of ``--executor``, in lower case.

    The target is a function that gets :class:`physic_core.batch.executors.ExecutorSettings` and returns an
    :data:`physic_core.batch.run.Executor`.
    """


class MomentRecord(_TargetRecord):
    """How ``physic batch`` joins photos of one moment; only one installed plugin may do it.

    The target is a function that gets a sequence of :class:`physic_core.batch.moments.MomentPhoto` and the
    :class:`physic_core.Config` of the batch, and returns one :class:`physic_core.Reconstruction` with ``cameras``, or a
    tuple of it and a mapping from names to contents (bytes) of files that belong beside it.
    """


class ReportRecord(_TargetRecord):
    """The page of a result, ``report.html``; only one installed plugin may make it.

    The target is a function that gets a :class:`physic_core.Reconstruction`, or the :class:`physic_core.InputError`
    that says why it cannot be read, and a title, and returns HTML as text. The HTML has
    :data:`physic_core.visual.report.PAGE_MARK` in its first 500 bytes.
    """


@dataclass(frozen=True)
class ExporterRecord:
    """A format of ``physic export``.

    Attributes:
        name: as in ``physic export --to NAME``, lower case with hyphens.
        suffixes: of its files, lower case with the dot, the default first.
        target: "package.module:function" of a function that gets a
            :class:`physic_core.ExportRequest` and returns :class:`physic_core.ExportedFiles`; imported when a result is
            exported.
        audience: programs that read it.
        content: what is in it.
        ups: up axes that it can be written with ("y", "z", "camera"), the default first. The axes are described in
            docs/exports.md.
        stem: file name without suffix, if no path is given; empty for ``name``.
        bodies: which people it writes: "any" without a body too, "optional" only those with a body, "required" the
            same, and at least one.
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
    bodies: Literal["any", "optional", "required"] = "optional"
    per_person: bool = False
    needs: str = ""
    packages: tuple[str, ...] = ()
    extra: str = ""
    options: Mapping[str, tuple[str | bool, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.suffixes or isinstance(self.suffixes, str) or not all(s.startswith(".") for s in self.suffixes):
            raise ValueError(f"suffixes of the exporter {self.name!r} should be like ('.fbx',), got {self.suffixes!r}")
        if self.bodies not in ("any", "optional", "required"):
            raise ValueError(
                f"bodies of the exporter {self.name!r} should be 'any', 'optional' or 'required', got {self.bodies!r}"
            )
        if not self.ups or isinstance(self.ups, str) or set(self.ups) - {"y", "z", "camera"}:
            raise ValueError(f"ups of the exporter {self.name!r} should be of 'y', 'z' and 'camera', got {self.ups!r}")

    @property
    def missing_packages(self) -> tuple[str, ...]:
        """The required packages that are not installed."""
        return tuple(package for package in self.packages if find_spec(package) is None)


RECORD_HOOKS: dict[type[Any], str] = {
    CommandRecord: "physic_commands",
    EnergyRecord: "physic_energies",
    ExecutorRecord: "physic_executors",
    ExporterRecord: "physic_exporters",
    MomentRecord: "physic_moments",
    ReportRecord: "physic_reports",
}
"""The hook that returns each kind of record but backends."""
