"""Which backends there are, by interface and name."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["PLUGIN_API", "BackendRecord"]

PLUGIN_API = 1
"""Version of the contract between the core and its plugins: the hook, the record and the eight interfaces."""


@dataclass(frozen=True)
class BackendRecord:
    """What a plugin says about one backend.

    Attributes:
        interface: "segmenter", "inpainter", "metric_depth", "relative_pointmap", "keypoint_detector", "body_estimator",
            "hand_estimator" or "contact_prior".
        name: the backend's name in configs, lower case with hyphens.
        target: "package.module:Class", imported when the backend is first used.
        api: plugin API that the backend was written for.
        summary: one line for ``physic plugins``.
        weights_license: licence of the weights in words; empty where there are none.
        needs: what it needs beyond its distribution, one word or phrase each ("GPU", "a checkpoint file").
        homepage: where to read more.
    """

    interface: str
    name: str
    target: str
    api: int = PLUGIN_API
    summary: str = ""
    weights_license: str = ""
    needs: tuple[str, ...] = ()
    homepage: str = ""
