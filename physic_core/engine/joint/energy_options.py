"""Options of an energy: its vertices, their visibility, and its floor."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["EnergyOptions"]


@dataclass(frozen=True)
class EnergyOptions:
    """Options of one energy, constant during the optimisation.

    Attributes:
        search_radius_m: search radius of vertices for scene points, metres.
        facing_deg: see :class:`physic_core.engine.joint.settings.VisibilitySettings`, as the next two.
        mask_tolerance: see there.
        vertex_spacing_m: see there.
        static_contacts: feet, hands, thighs, seat and back of all people are contact vertices, instead of the prior's.
        coarse_self_occlusion: self-occlusion is computed at vertices 2 cm apart and copied to their neighbours.
        floor_samples: samples of the floor are scene points; else the floor is a plane.
        along_normals: distances are along normals: scene points without one are left out.
        free_space: vertices nearer than the depth map at their pixel do not penetrate.
        people_by_size: people count in the energy by their visible size in the photo, so that the scene's scale follows
            the best visible ones; else all count alike.
    """

    search_radius_m: float
    facing_deg: float
    mask_tolerance: float
    vertex_spacing_m: float
    static_contacts: bool = False
    coarse_self_occlusion: bool = False
    floor_samples: bool = False
    along_normals: bool = False
    free_space: bool = False
    people_by_size: bool = False
