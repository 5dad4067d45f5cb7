"""Contact of bodies: distances, probabilities and partners of each vertex (paper sec. 3.3). Camera frame, metres."""

from __future__ import annotations

from physic_core.engine.contact.distance import SEARCH_RADIUS_M, contact_map, contact_surfaces, surface_distance

__all__ = ["SEARCH_RADIUS_M", "contact_map", "contact_surfaces", "surface_distance"]
