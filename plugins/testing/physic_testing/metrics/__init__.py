"""Metrics of a reconstruction against ground truth, and tables and intervals of them; import names
from here.
"""

from __future__ import annotations

from physic_testing.metrics.contact import (
    ContactCounts,
    ContactScores,
    GeodesicError,
    contact_counts,
    contact_scores,
    distance_to_sources,
    geodesic_error,
    precision_recall_f1,
    surface_graph,
)
from physic_testing.metrics.intervals import (
    DRAWS,
    ValueWithInterval,
    aligned_table,
    draw_counts,
    markdown_table,
    percentile_interval,
    resampled_interval,
)
from physic_testing.metrics.matching import (
    Matching,
    assign,
    mask_iou,
    match_by_boxes,
    match_by_masks,
)
from physic_testing.metrics.pose import (
    BODY_JOINTS,
    align_similarity,
    mpjpe_mm,
    mpvpe_mm,
    pa_mpjpe_mm,
)
from physic_testing.metrics.scene import (
    PROXIMITY_RADIUS_M,
    Penetration,
    contact_gap,
    hidden_by_depth_map,
    penetration,
    point_spacing,
    scene_distance,
)

__all__ = [
    "BODY_JOINTS",
    "DRAWS",
    "PROXIMITY_RADIUS_M",
    "ContactCounts",
    "ContactScores",
    "GeodesicError",
    "Matching",
    "Penetration",
    "ValueWithInterval",
    "align_similarity",
    "aligned_table",
    "assign",
    "contact_counts",
    "contact_gap",
    "contact_scores",
    "distance_to_sources",
    "draw_counts",
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
    "surface_graph",
]
