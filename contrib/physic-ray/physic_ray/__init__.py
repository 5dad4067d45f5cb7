"""PhySIC on a Ray cluster: the executor "ray" of ``physic batch``, and :func:`reconstruct` for Ray Data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from physic_core import ExecutorRecord, hookimpl

if TYPE_CHECKING:
    from physic_ray.dataset import reconstruct
    from physic_ray.resources import Resources

__all__ = ["Resources", "physic_executors", "reconstruct"]


@hookimpl
def physic_executors() -> list[ExecutorRecord]:
    """Return the executor "ray"; nothing of Ray is imported."""
    return [ExecutorRecord("ray", "physic_ray.executor:ray_executor", "Actors of a Ray cluster.")]


def __getattr__(name: str) -> Any:
    if name == "reconstruct":
        from physic_ray.dataset import reconstruct

        return reconstruct
    if name == "Resources":
        from physic_ray.resources import Resources

        return Resources
    raise AttributeError(f"module 'physic_ray' has no attribute '{name}'")
