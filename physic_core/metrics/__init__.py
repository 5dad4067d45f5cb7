"""Metrics of a reconstruction against ground truth, and tables and intervals of them; import names from here."""

from __future__ import annotations

from physic_core.metrics.contact import (
    ContactCounts,
    ContactScores,
    contact_counts,
    contact_scores,
    precision_recall_f1,
)
from physic_core.metrics.geodesic import GeodesicError, distance_to_sources, geodesic_error, surface_graph
from physic_core.metrics.intervals import DRAWS, ValueWithInterval, draw_counts, percentile_interval, resampled_interval
from physic_core.metrics.matching import Matching, assign, mask_iou, match_by_boxes, match_by_masks
from physic_core.metrics.physics import Penetration, contact_gap, penetration
from physic_core.metrics.pose import BODY_JOINTS, align_similarity, mpjpe_mm, mpvpe_mm, pa_mpjpe_mm
from physic_core.metrics.proximity import (
    PROXIMITY_RADIUS_M,
    SignedDistances,
    hidden_by_depth_map,
    point_spacing,
    scene_distance,
)
from physic_core.metrics.scene import FloorError, SceneError, floor_error, scene_error
from physic_core.metrics.tables import aligned_table, markdown_table

__all__ = [
    "BODY_JOINTS",
    "DRAWS",
    "PROXIMITY_RADIUS_M",
    "ContactCounts",
    "ContactScores",
    "FloorError",
    "GeodesicError",
    "Matching",
    "Penetration",
    "SceneError",
    "SignedDistances",
    "ValueWithInterval",
    "align_similarity",
    "aligned_table",
    "assign",
    "contact_counts",
    "contact_gap",
    "contact_scores",
    "distance_to_sources",
    "draw_counts",
    "floor_error",
    "geodesic_error",
    "hidden_by_depth_map",
    "markdown_table",
    "mask_iou",
    "match_by_boxes",
    "match_by_masks",
    "mpjpe_mm",
    "mpvpe_mm",
    "pa_mpjpe_mm",
    "penetration",
    "percentile_interval",
    "point_spacing",
    "precision_recall_f1",
    "resampled_interval",
    "scene_distance",
    "scene_error",
    "surface_graph",
]
