"""One reconstruction from two to eight photos of one moment: ``ScenePipeline`` and the command
``physic scene``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from physic_core import PluginItem, hookimpl

if TYPE_CHECKING:
    from physic_scene.calibration import KnownCamera, read_calibration
    from physic_scene.output import save_scene
    from physic_scene.scene_pipeline import ScenePipeline
    from physic_scene.types import SceneResult, SolvedPhoto

__all__ = [
    "KnownCamera",
    "ScenePipeline",
    "SceneResult",
    "SolvedPhoto",
    "physic_commands",
    "read_calibration",
    "save_scene",
]

_NAMES = {
    "SolvedPhoto": "types",
    "KnownCamera": "calibration",
    "SceneResult": "types",
    "ScenePipeline": "scene_pipeline",
    "read_calibration": "calibration",
    "save_scene": "output",
}


@hookimpl
def physic_commands() -> list[PluginItem]:
    """Return the record of ``physic scene``."""
    return [
        PluginItem(
            "scene",
            "physic_scene.command:scene",
            "Reconstruct one moment from two to eight photos.",
        )
    ]


def __getattr__(name: str) -> Any:
    if name not in _NAMES:
        raise AttributeError(f"module 'physic_scene' has no attribute '{name}'")
    return getattr(import_module(f"physic_scene.{_NAMES[name]}"), name)
