"""Settings of stage 2: the points of people, and the alignment of bodies with them."""

from __future__ import annotations

from dataclasses import dataclass

from physic_core.types.bounds import NotNegative, PointCount, Positive, PositiveOrInfinite, Share


@dataclass(frozen=True)
class PlacementSettings:
    """Settings of stage 2: human points in the scene, and body translation (paper Sec. 3.2, Eq. 2-4)."""

    reprojection_weight: NotNegative = 1000.0
    """Lambda_j2d of Eq. 3."""
    chamfer_weight: NotNegative = 0.6
    """Lambda_d of Eq. 3; 0 stops after Eq. 2."""
    min_confidence: Share = 0.3
    """Keypoints of lower confidence are ignored."""
    robust_px_share: PositiveOrInfinite = 0.05
    """Scale of the robust reprojection error, as a share of the person's size in the image; "inf" is least squares."""
    robust_m: PositiveOrInfinite = 0.15
    """Minimum scale of the robust Chamfer distance, metres; "inf" is least squares."""
    max_points: PointCount = 1000
    """Maximum number of a person's points, and of camera-facing vertices, in Eq. 4; its run time is proportional to
    it."""
    depth_offset_sigma: NotNegative = 0.2
    """Prior of log(depth offset) of a person with visible feet on a known floor; 0 fixes the human points to the
    scene."""
    floor_weight: NotNegative = 1.0
    """Weight of the distance of the lower foot to the floor, for visible feet on a known floor; 0 disables it."""
    detect_lifted_feet: bool = True
    """Feet with a depth gap behind them are in the air (:mod:`physic_core.engine.placement.lifted_feet`), in photos
    whose segmenter labels surfaces."""
    feet_by_picture: bool = True
    """Feet are pulled to the floor in proportion to the image probability that they touch something
    (:mod:`physic_core.body.feet_in_picture`)."""
    lifted_sigmas: Positive = 3.0
    """Both feet are in the air if a person is this many standard deviations from standing on the floor
    (:func:`physic_core.engine.sizes.standing_scores`)."""
