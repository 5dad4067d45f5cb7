"""Every number that the engine can be told, as plain frozen dataclasses.

One class per stage: :class:`SceneSettings` (stage 1), :class:`HumanSettings` (stage 2), :class:`JointSettings`
(stage 3) and :class:`ContactSettings` (the contact map); :class:`EngineSettings` holds the four. The defaults are
preset "default"; the others are in :mod:`physic_core.engine.presets`. Each field says what it is, which values are
good, and which value switches it off. Change some of them with :func:`dataclasses.replace`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from physic_core.engine.bounds import (
    Count,
    Degrees,
    NotNegative,
    Positive,
    PositiveCount,
    PositiveOrInfinite,
    Ratio,
    Share,
)
from physic_core.engine.joint.settings import JointSettings

__all__ = ["ContactSettings", "EngineSettings", "HumanSettings", "JointSettings", "SceneSettings"]


@dataclass(frozen=True)
class SceneSettings:
    """Stage 1: metric scene points, camera, normals, floor (paper Sec. 3.1).

    Attributes:
        source: where the scene's shape comes from: the relative "pointmap", put into metres, or the "metric_depth"
            alone, as the paper gives it to PROX.
        align_hypotheses: RANSAC draws of Eq. 1; 20 (released code) to 500.
        align_tolerance: a pixel agrees with a hypothesis when its depth differs by less than this share; the same for
            all hypotheses, so that their counts can be compared. 0.05-0.15.
        align_residual: "relative" weighs each pixel by its depth; "metric" is the plain metres of Eq. 1.
        align_max_pixels: pixels that Eq. 1 looks at; more changes little beyond 10,000.
        align_min_share: below this share of agreeing pixels the alignment is reported as doubtful.
        intrinsics: camera where none is given: "both" is the mean of what metric depth and point map see, and the
            metric depth keeps the sizes that it saw with its own; "metric" takes that of the metric depth (else the
            point map's). Both put every point on its ray; "pointmap" is the paper's median, points left as they are.
        edge_ratio: farthest / nearest depth among 3 x 3 pixels beyond which a pixel is a depth edge; 1.03-1.10,
            "inf" keeps all.
        outliers: "grid" compares each point with its neighbours in the image (fast), "knn" is the paper's mean
            distance to the k nearest points, "off" keeps all.
        outlier_neighbors: k as a share of the short image side, the point itself among them ("knn").
        outlier_sigma: a point is dropped beyond mean + this many standard deviations ("knn").
        far_m: points beyond are invalid, metres.
        normals: "own" leaves neighbours across a depth edge out; "released" takes means of four cross products, and
            drops points whose normal is turned away from their neighbours'.
        floor: "disparity" fits a plane in 1 / Z, "metric" is the paper's RANSAC on points of the floor mask, "off".
        floor_hypotheses: RANSAC draws.
        floor_tolerance: how far an inlier may be off, as a share of the range of 1 / Z ("disparity"); 0.008-0.03.
        floor_mask_slack: where no plane holds on the floor mask it is tried again with this many tolerances
            ("disparity"); 2-3, 1 does not.
        floor_tolerance_m: how far an inlier may be off, metres ("metric").
        floor_min_share: share of the searched pixels that must agree; 0.3 separates usable floors from none.
        floor_mask_min_share: the same where the search is bound to a floor mask.
        floor_feet_min_share: as ``floor_min_share``, for a plane that passes through people's feet by itself.
        floor_max_below: largest share of valid pixels that may lie clearly below a floor.
        floor_max_roll_deg: how far the floor may tilt sideways in the picture, degrees.
        floor_hole_weight: weight of inpainted pixels in the fit, 0-1.
        floor_lower_share: part of the picture, from below, that is searched where there is no floor mask.
        floor_firmness: how clearly the surfaces must tell which way is up for the floor to be square to it; 0.1-0.2,
            1 does not ask them ("disparity").
        floor_reanchor: move an accepted floor, its horizon kept, to the depth seen round the feet.
        floor_feet_window: how far round the feet, as a share of the long image side; 0.02-0.15.
        floor_under_people: where no floor is seen, put one under the soles of people who stand or sit upright.
        floor_spacing_m: distance of floor points near the people, metres; 0.02-0.05.
        floor_near_m: how far "near the people" reaches, metres.
        floor_max_points: floor points at most; 0 makes none.
        floor_grid: a plain grid of this many points a side instead (released code: 100); 0 switches it off.
        carve_m: scene that an inpainter made up and that ends inside a body, or before one where the photo shows it,
            moves behind it, by this much at most, metres; 0 leaves it where it is.
        seed: of every random draw in this stage.
    """

    source: Literal["pointmap", "metric_depth"] = "pointmap"
    align_hypotheses: PositiveCount = 128
    align_tolerance: Positive = 0.1
    align_residual: Literal["relative", "metric"] = "relative"
    align_max_pixels: PositiveCount = 20_000
    align_min_share: Share = 0.5
    intrinsics: Literal["both", "metric", "pointmap"] = "both"
    edge_ratio: Ratio = 1.05
    outliers: Literal["grid", "knn", "off"] = "grid"
    outlier_neighbors: Positive = 0.05
    outlier_sigma: PositiveOrInfinite = 1.45
    far_m: PositiveOrInfinite = 50.0
    normals: Literal["own", "released"] = "own"
    floor: Literal["disparity", "metric", "off"] = "disparity"
    floor_hypotheses: PositiveCount = 1000
    floor_tolerance: Positive = 0.02
    floor_mask_slack: Positive = 2.5
    floor_tolerance_m: Positive = 0.01
    floor_min_share: Share = 0.3
    floor_mask_min_share: Share = 0.5
    floor_feet_min_share: Share = 0.15
    floor_max_below: Share = 0.1
    floor_max_roll_deg: Degrees = 25.0
    floor_hole_weight: Share = 0.3
    floor_lower_share: Share = 0.6
    floor_firmness: Share = 0.11
    floor_reanchor: bool = True
    floor_feet_window: Share = 0.08
    floor_under_people: bool = True
    floor_spacing_m: Positive = 0.025
    floor_near_m: NotNegative = 1.5
    floor_max_points: Count = 40_000
    floor_grid: Count = 0
    carve_m: NotNegative = 0.5
    seed: Count = 0


@dataclass(frozen=True)
class HumanSettings:
    """Stage 2: human points in the scene, and each body moved onto them (paper Sec. 3.2, Eq. 2-4).

    Attributes:
        align_hypotheses: as in :class:`SceneSettings`, for original against inpainted photo.
        align_tolerance: as in :class:`SceneSettings`; a tight one, below 0.1, follows whichever surface agrees best
            and lets the others go, where the network saw two different rooms.
        align_residual: as in :class:`SceneSettings`.
        align_max_pixels: as in :class:`SceneSettings`.
        align_min_share: as in :class:`SceneSettings`.
        align_depth_share: background counts most at the people's own depth, and falls off with the difference of
            inverse depths over this share of their range; 0.1-0.3, 0 counts all alike.
        mask_dilation: people's masks are grown by this share of the long image side before the background is aligned.
        far_m: pixels beyond are left out of that alignment, metres.
        edge_ratio: as in :class:`SceneSettings`, within a person.
        outliers: as in :class:`SceneSettings`, within a person.
        outlier_neighbors: as in :class:`SceneSettings`.
        outlier_sigma: as in :class:`SceneSettings`.
        max_points: human points of one person at most, picked evenly; 0 keeps all.
        min_points: fewer human points than this and the body is placed by reprojection alone.
        solver: "gauss_newton" to convergence, or "adam_lbfgs" as the paper says.
        reduction: of the Chamfer distance: "mean" does not depend on the resolution, "sum" is Eq. 4 as printed.
        visibility: a vertex is on the photo within the person's "own" mask, and faces the camera along its ray.
            "released" takes all people's masks as one, by which who is hidden behind another is visible, and the
            optical axis.
        reprojection_loss: "square", or "released": absolute errors, weights and mean as in the released code; of
            "adam_lbfgs" only.
        normalisation: 2D errors are shares of the "person" in the picture (same at every size) or of the "image".
        reprojection_mean: over keypoints, weighted by their confidence, instead of the sum that Eq. 2 prints.
        reprojection_weight: lambda_j2d of Eq. 3.
        chamfer_weight: lambda_d of Eq. 3; 0 stops after Eq. 2.
        facing_deg: a vertex faces the camera when its normal is within this angle of the direction to the camera.
        min_confidence: keypoints below count nothing.
        seen_confidence: a joint whose keypoint is this sure and lies on the person's own mask is seen, whatever the
            body estimator says; 1 believes the body estimator alone.
        mixed_sides_deg: left and right of a person's arms, or legs, are exchanged among the keypoints whose ways from
            left to right point farther than this from the placed body's; 180 believes the keypoints.
        robust_px_share: scale of the robust reprojection error, as a share of the normalising length; "inf" is plain
            least squares.
        robust_m: scale of the robust Chamfer distance, metres, wider where most points are farther off; "inf" is plain
            least squares.
        depth_offset_sigma: prior of log(depth offset) of a person whose feet stand on a known floor; 0 ties the human
            points to the scene.
        floor_weight: pull of the lower foot onto the floor, for the same people; 0 switches it off.
        floor_robust_m: scale of the robust pull, metres: a foot that is much farther off is not on the floor.
        stand_reach_m: who, tied to the scene, has the lower foot higher over the floor than this stands or lies on
            something else, and stays tied; 0 lets everybody stand.
        stand_reach_share: the same as a share of the distance from the camera; the smaller of the two counts.
        iterations: Gauss-Newton steps at most, or Adam's steps on Eq. 2.
        learning_rate: Adam's.
        lbfgs_steps: L-BFGS steps on Eq. 3 ("adam_lbfgs").
        lbfgs_inner: iterations inside each of them.
        keypoint_bound: nobody ends farther off their keypoints than the body estimator put them, neither by L_j2d nor
            by the median distance: lambda_j2d of Eq. 3 is doubled, its pairs of vertices and points kept, until that
            holds ("adam_lbfgs").
        lbfgs_line_search: each of them looks how far to go (strong Wolfe), instead of a unit step as printed, which
            with "released" pixels leads away from the minimum.
        seed: of every random draw in this stage.
    """

    align_hypotheses: PositiveCount = 128
    align_tolerance: Positive = 0.15
    align_residual: Literal["relative", "metric"] = "relative"
    align_max_pixels: PositiveCount = 20_000
    align_min_share: Share = 0.5
    align_depth_share: NotNegative = 0.15
    mask_dilation: NotNegative = 0.01
    far_m: PositiveOrInfinite = 50.0
    edge_ratio: Ratio = 1.05
    outliers: Literal["grid", "knn", "off"] = "grid"
    outlier_neighbors: Positive = 0.05
    outlier_sigma: PositiveOrInfinite = 1.45
    max_points: Count = 3000
    min_points: Count = 50
    solver: Literal["gauss_newton", "adam_lbfgs"] = "gauss_newton"
    reduction: Literal["mean", "sum"] = "mean"
    visibility: Literal["own", "released"] = "own"
    reprojection_loss: Literal["square", "released"] = "square"
    normalisation: Literal["person", "image"] = "person"
    reprojection_mean: bool = True
    reprojection_weight: NotNegative = 1000.0
    chamfer_weight: NotNegative = 0.6
    facing_deg: Degrees = 70.0
    min_confidence: Share = 0.3
    seen_confidence: Share = 0.7
    mixed_sides_deg: Degrees = 125.0
    robust_px_share: PositiveOrInfinite = 0.05
    robust_m: PositiveOrInfinite = 0.15
    depth_offset_sigma: NotNegative = 0.2
    floor_weight: NotNegative = 1.0
    floor_robust_m: PositiveOrInfinite = 0.3
    stand_reach_m: NotNegative = 0.45
    stand_reach_share: NotNegative = 0.15
    iterations: PositiveCount = 30
    learning_rate: Positive = 1e-2
    lbfgs_steps: PositiveCount = 2
    lbfgs_inner: PositiveCount = 15
    keypoint_bound: bool = False
    lbfgs_line_search: bool = False
    seed: Count = 0


@dataclass(frozen=True)
class ContactSettings:
    """The contact map.

    Attributes:
        distance_m: a vertex nearer than this to the scene or the floor touches it, metres; 0.02 as released.
        inside_m: a vertex that lies at most this far inside touches it too, metres; 0.15 as released. 0.05 is how far
            flesh and cushions give way.
        reach_m: distances beyond are reported as infinite, metres.
        metric: "plane" measures along the surface's normal, "point" to the nearest point.
        facing: only where the body's surface faces the scene's, so that the upper side of a foot does not touch the
            floor. Datasets label by distance alone, and so does the default.
        observed: only on limbs that the photo shows.
    """

    distance_m: NotNegative = 0.02
    inside_m: NotNegative = 0.05
    reach_m: Positive = 0.15
    metric: Literal["plane", "point"] = "plane"
    facing: bool = False
    observed: bool = True


@dataclass(frozen=True)
class EngineSettings:
    """What the engine is told: one object per stage."""

    scene: SceneSettings = field(default_factory=SceneSettings)
    human: HumanSettings = field(default_factory=HumanSettings)
    joint: JointSettings = field(default_factory=JointSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)
