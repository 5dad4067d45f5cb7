"""Records of backends, commands and executors, which plugin hooks return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.interfaces import Backend

__all__ = ["BackendRecord", "CommandRecord", "ExecutorRecord"]


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
class CommandRecord:
    """A command that a plugin adds to ``physic``.

    Attributes:
        name: words after ``physic``, such as "bench" or "plugins check".
        target: "package.module:function" of a ``click.Command``, imported when the command is run.
        summary: one line for ``--help``.
    """

    name: str
    target: str
    summary: str = ""


@dataclass(frozen=True)
class ExecutorRecord:
    """A way to run ``physic batch``, such as on a cluster.

    Attributes:
        name: value of ``--executor``, lower case with hyphens.
        target: "package.module:function" of a function that gets :class:`physic_core.batch.executors.ExecutorSettings`
            and returns an :data:`physic_core.batch.run.Executor`; imported when the executor is used.
        summary: one line for messages.
    """

    name: str
    target: str
    summary: str = ""
