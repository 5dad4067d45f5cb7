"""Records of backends, commands and exporters, which hooks of plugins return."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.interfaces import Backend


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
class TargetRecord:
    """An entry point of a group without hooks.

    Attributes:
        name: of the entry point.
        target: "package.module:name" of a function or object, imported when it is used.
    """

    name: str
    target: str


@dataclass(frozen=True)
class CommandRecord:
    """A command that a plugin adds to ``physic``.

    Attributes:
        name: the words after ``physic``, such as "bench" or "plugins check".
        target: "package.module:name" of a ``click.Command``, imported when the command runs.
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
            :class:`physic_core.ExportRequest` and returns :class:`physic_core.ExportedFiles`; imported when a result is
            exported.
        audience: programs that read it.
        content: what is in it.
        ups: up axes that it can be written with ("y", "z", "camera"), the default first. The axes are described in
            docs/exports.md.
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

    def __post_init__(self) -> None:
        if not self.suffixes or isinstance(self.suffixes, str) or not all(s.startswith(".") for s in self.suffixes):
            raise ValueError(f"suffixes of the exporter {self.name!r} should be like ('.fbx',), got {self.suffixes!r}")
        if self.bodies not in ("optional", "required"):
            raise ValueError(
                f"bodies of the exporter {self.name!r} should be 'optional' or 'required', got {self.bodies!r}"
            )
        if not self.ups or isinstance(self.ups, str) or set(self.ups) - {"y", "z", "camera"}:
            raise ValueError(f"ups of the exporter {self.name!r} should be of 'y', 'z' and 'camera', got {self.ups!r}")

    @property
    def missing_packages(self) -> tuple[str, ...]:
        """The required packages that are not installed."""
        return tuple(package for package in self.packages if find_spec(package) is None)


RECORD_HOOKS: dict[type[Any], str] = {CommandRecord: "physic_commands", ExporterRecord: "physic_exporters"}
"""The hook that returns each kind of record but backends."""
