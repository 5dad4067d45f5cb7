"""What the hooks of a plugin return: its backends and its commands, each named by a text that is imported on use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physic_core.interfaces import Backend

__all__ = ["BackendRecord", "CommandRecord"]


@dataclass(frozen=True)
class BackendRecord:
    """One backend of a plugin.

    Attributes:
        interface: "segmenter", "inpainter", "metric_depth", "relative_pointmap", "keypoint_detector", "body_estimator",
            "hand_estimator" or "contact_prior".
        name: the backend's name in configs, lower case with hyphens.
        target: "package.module:Class", imported when the backend is first used. In a registry built by hand, the class
            itself will do.
        api: version of the interface that the backend was written for, such as 1; a core with another one refuses it.
        summary: one line for ``physic plugins``.
        weights_license: licence of the weights in words; empty where there are none.
        needs: what it needs beyond its distribution, one word or phrase each ("GPU", "a checkpoint file").
        homepage: where to read more.
        packages: import names of what else has to be installed, such as that of an extra; ``physic plugins`` looks for
            them without importing them.
        weights: names of the sets of its plugin's list of weights that it reads where no option says otherwise;
            ``physic plugins`` looks for their files, which answers the need "weights".
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
        name: how it is called, such as "bench" for ``physic bench``, or "plugins check" for ``physic plugins check``.
        target: "package.module:function" of a ``click.Command``, imported when the command is run.
        summary: one line for ``--help``.
    """

    name: str
    target: str
    summary: str = ""
