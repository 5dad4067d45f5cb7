"""PhySIC on a Ray cluster: the executor "ray" of ``physic batch``, and :func:`reconstruct` for Ray
Data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from physic_core import PluginItem, hookimpl

if TYPE_CHECKING:
    from physic_ray.dataset import reconstruct
    from physic_ray.resources import Resources

__all__ = ["Resources", "reconstruct"]


@hookimpl
def physic_executors() -> list[PluginItem]:
    """Return the executor of a Ray cluster."""
    return [PluginItem("ray", "physic_ray.executor:ray_executor")]


def __getattr__(name: str) -> Any:
    if name == "reconstruct":
        from physic_ray.dataset import reconstruct

        return reconstruct
    if name == "Resources":
        from physic_ray.resources import Resources

        return Resources
    raise AttributeError(f"module 'physic_ray' has no attribute '{name}'")
