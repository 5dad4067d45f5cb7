"""Ray casts of the worlds, which are those of the core."""

from physic_core.geometry.rays import RayCaster, RayHits

__all__ = ["RayCaster", "RayHits"]
