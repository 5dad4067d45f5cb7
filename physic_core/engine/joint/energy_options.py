"""Options of a preset's energy: its vertices, limbs, masks and floor, and the search for nearest points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from physic_core.engine.bounds import NearestStrategy

__all__ = ["EnergyOptions"]


@dataclass(frozen=True)
class EnergyOptions:
    """Options of one preset's energy, constant during the optimisation.

    Attributes:
        search_radius_m: search radius of vertices for scene points, metres.
        facing_deg: see :class:`physic_core.engine.joint.settings.VisibilitySettings`, as the next two.
        mask_tolerance: see there.
        vertex_spacing_m: see there.
        count_vertices: every vertex has weight 1; else its surface area.
        observed_limbs_only: invisible limbs are left out; else all limbs count as visible.
        static_contacts: feet, hands, thighs, seat and back of all people are contact vertices, instead of the prior's.
        merge_masks: the union of all masks is used for all people; else each person's own mask.
        coarse_self_occlusion: self-occlusion is computed at vertices 2 cm apart and copied to their neighbours.
        floor: "plane" uses the fitted plane, "points" adds samples of it to the scene, "ignored" neither.
        along_normals: distances are along normals: scene points without one are left out.
        free_space: vertices nearer than the depth map at their pixel do not penetrate.
        people_by_size: people count in the energy by their visible size in the photo, so that the scene's scale follows
            the best visible ones; else all count alike.
        nearest: strategy of the search for nearest points.
        nearest_every_step: nearest points are searched at every evaluation, not only when visibility is updated.
    """

    search_radius_m: float
    facing_deg: float
    mask_tolerance: float
    vertex_spacing_m: float
    count_vertices: bool = False
    observed_limbs_only: bool = True
    static_contacts: bool = False
    merge_masks: bool = False
    coarse_self_occlusion: bool = False
    floor: Literal["plane", "points", "ignored"] = "plane"
    along_normals: bool = False
    free_space: bool = False
    people_by_size: bool = False
    nearest: NearestStrategy = "kdtree"
    nearest_every_step: bool = False
