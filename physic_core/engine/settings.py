"""Every number that the engine can be told, as plain frozen dataclasses.

One class per stage: :class:`SceneSettings` (stage 1), :class:`HumanSettings` (stage 2), :class:`JointSettings`
(stage 3) and :class:`ContactSettings` (the contact map); :class:`EngineSettings` holds the four. The defaults are
preset "default"; ``PRESETS["paper"]`` holds the equations and weights as printed. Each field says what it is, which
values are good, and which value switches it off. Change some of them with :func:`dataclasses.replace`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Interval

# What a field may hold stands beside it; whoever reads settings from outside can check it without a list of names.
Positive = Annotated[float, Interval(gt=0, lt=math.inf)]
PositiveOrInfinite = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Interval(ge=0, lt=math.inf)]
Share = Annotated[float, Interval(ge=0, le=1)]
Ratio = Annotated[float, Gt(1)]
Degrees = Annotated[float, Interval(gt=0, le=180)]
Count = Annotated[int, Ge(0)]
PositiveCount = Annotated[int, Gt(0)]
RobustKind = Literal["square", "pseudo_huber", "cauchy", "geman_mcclure", "barron"]

__all__ = [
    "PRESETS",
    "ContactSettings",
    "EngineSettings",
    "HumanSettings",
    "JointSettings",
    "SceneSettings",
]


@dataclass(frozen=True)
class SceneSettings:
    """Stage 1: metric scene points, camera, normals, floor (paper Sec. 3.1).

    Attributes:
        align_hypotheses: RANSAC draws of Eq. 1; 20 (released code) to 500.
        align_tolerance: a pixel agrees with a hypothesis when its depth differs by less than this share; the same for
            all hypotheses, so that their counts can be compared. 0.05-0.15.
        align_residual: "relative" weighs each pixel by its depth; "metric" is the plain metres of Eq. 1.
        align_max_pixels: pixels that Eq. 1 looks at; more changes little beyond 10,000.
        align_min_share: below this share of agreeing pixels the alignment is reported as doubtful.
        intrinsics: camera where none is given: "metric" takes that of the metric depth (else the point map's) and
            puts every point on its ray; "pointmap" is the paper's median, points left as they are.
        edge_ratio: farthest / nearest depth among 3 x 3 pixels beyond which a pixel is a depth edge; 1.03-1.10,
            "inf" keeps all.
        outliers: "grid" compares each point with its neighbours in the image (fast), "knn" is the paper's mean
            distance to the k nearest points, "off" keeps all.
        outlier_neighbors: k as a share of the short image side ("knn").
        outlier_sigma: a point is dropped beyond mean + this many standard deviations ("knn").
        far_m: points beyond are invalid, metres.
        floor: "disparity" fits a plane in 1 / Z, "metric" is the paper's RANSAC on points of the floor mask, "off".
        floor_hypotheses: RANSAC draws.
        floor_tolerance: how far an inlier may be off, as a share of the range of 1 / Z ("disparity"); 0.008-0.02.
        floor_tolerance_m: how far an inlier may be off, metres ("metric").
        floor_min_share: share of the searched pixels that must agree; 0.3 separates usable floors from none.
        floor_mask_min_share: the same where the search is bound to a floor mask.
        floor_feet_min_share: as ``floor_min_share``, for a plane that passes through people's feet by itself.
        floor_max_below: largest share of valid pixels that may lie clearly below a floor.
        floor_max_roll_deg: how far the floor may tilt sideways in the picture, degrees.
        floor_hole_weight: weight of inpainted pixels in the fit, 0-1.
        floor_lower_share: part of the picture, from below, that is searched where there is no floor mask.
        floor_reanchor: move an accepted floor, its horizon kept, to the depth seen at the feet.
        floor_spacing_m: distance of floor points near the people, metres; 0.02-0.05.
        floor_near_m: how far "near the people" reaches, metres.
        floor_max_points: floor points at most; 0 makes none.
        floor_grid: a plain grid of this many points a side instead (released code: 100); 0 switches it off.
        seed: of every random draw in this stage.
    """

    align_hypotheses: PositiveCount = 128
    align_tolerance: Positive = 0.1
    align_residual: Literal["relative", "metric"] = "relative"
    align_max_pixels: PositiveCount = 20_000
    align_min_share: Share = 0.5
    intrinsics: Literal["metric", "pointmap"] = "metric"
    edge_ratio: Ratio = 1.05
    outliers: Literal["grid", "knn", "off"] = "grid"
    outlier_neighbors: Positive = 0.05
    outlier_sigma: PositiveOrInfinite = 1.45
    far_m: PositiveOrInfinite = 50.0
    floor: Literal["disparity", "metric", "off"] = "disparity"
    floor_hypotheses: PositiveCount = 1000
    floor_tolerance: Positive = 0.012
    floor_tolerance_m: Positive = 0.01
    floor_min_share: Share = 0.3
    floor_mask_min_share: Share = 0.5
    floor_feet_min_share: Share = 0.15
    floor_max_below: Share = 0.1
    floor_max_roll_deg: Degrees = 25.0
    floor_hole_weight: Share = 0.3
    floor_lower_share: Share = 0.6
    floor_reanchor: bool = True
    floor_spacing_m: Positive = 0.025
    floor_near_m: NotNegative = 1.5
    floor_max_points: Count = 40_000
    floor_grid: Count = 0
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
        normalisation: 2D errors are shares of the "person" in the picture (same at every size) or of the "image".
        reprojection_weight: lambda_j2d of Eq. 3.
        chamfer_weight: lambda_d of Eq. 3; 0 stops after Eq. 2.
        facing_deg: a vertex faces the camera when its normal is within this angle of the direction to the camera.
        min_confidence: keypoints below count nothing.
        robust_px_share: scale of the robust reprojection error, as a share of the normalising length; "inf" is plain
            least squares.
        robust_m: scale of the robust Chamfer distance, metres, wider where most points are farther off; "inf" is plain
            least squares.
        depth_offset_sigma: prior of log(depth offset) of a person whose feet stand on a known floor; 0 ties the human
            points to the scene.
        floor_weight: pull of the lower foot onto the floor, for the same people; 0 switches it off.
        floor_robust_m: scale of the robust pull, metres: a foot that is much farther off is not on the floor.
        iterations: Gauss-Newton steps at most, or Adam's steps on Eq. 2.
        learning_rate: Adam's.
        lbfgs_steps: L-BFGS steps on Eq. 3 ("adam_lbfgs").
        lbfgs_inner: iterations inside each of them.
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
    normalisation: Literal["person", "image"] = "person"
    reprojection_weight: NotNegative = 1000.0
    chamfer_weight: NotNegative = 0.6
    facing_deg: Degrees = 70.0
    min_confidence: Share = 0.3
    robust_px_share: PositiveOrInfinite = 0.05
    robust_m: PositiveOrInfinite = 0.15
    depth_offset_sigma: NotNegative = 0.2
    floor_weight: NotNegative = 1.0
    floor_robust_m: PositiveOrInfinite = 0.3
    iterations: PositiveCount = 30
    learning_rate: Positive = 1e-2
    lbfgs_steps: PositiveCount = 2
    lbfgs_inner: PositiveCount = 15
    seed: Count = 0


@dataclass(frozen=True)
class JointSettings:
    """Stage 3: pose, hands, shape, translation and scene scale together (paper Sec. 3.3, Eq. 5-7).

    A residual is divided by its "sigma", how far it may be off, and goes through a robust loss whose "scale" is in
    sigmas: beyond it a residual counts as an outlier. Losses: "square", "pseudo_huber" (constant pull), "cauchy"
    (ever weaker), "geman_mcclure" (lets go), "barron" (half a pseudo-Huber, as published). A weight of 0 switches a
    term off.

    Attributes:
        parameters: "whitened" deviations in units of their expected size, or the "raw" numbers themselves.
        frozen: groups that stay as they are: root, pose, hands, betas, translation, scale, offset.
        optimiser: "lbfgs" with a strong-Wolfe line search, or "adam".
        steps: at most; 40-100.
        refresh_steps: steps between two looks at visibility and, with "lbfgs", nearest points; 10-30.
        learning_rate: Adam's.
        tolerance: stop when a refresh's steps lower the energy by less than this share; 0 never stops early.
        nearest: nearest-point strategy, "kdtree" (exact), "grid" (the paper's 128^3 cells) or "brute".
        nearest_every_step: look up nearest points at every evaluation and not only at a refresh.
        reduction: "area" weighs each vertex by the surface that it stands for, in units of a square decimetre, so that
            every mesh gives the same energy; "sum" counts vertices, as printed.
        vertex_spacing_m: vertices that touch nothing are thinned to this spacing, metres; 0 keeps all.
        reprojection_weight: lambda_j2d of Eq. 5.
        reprojection_unit: 2D errors are shares of the "person" (stature in px) or of the "image" (width and height).
        reprojection_sigma: expected error in that unit; 0.01 of a person.
        reprojection_loss: robust loss.
        reprojection_scale: its scale, sigmas.
        reprojection_mean: over keypoints and axes, instead of the sum.
        min_confidence: keypoints below count ``low_confidence_weight`` times as much.
        low_confidence_weight: 0 drops them.
        depth_weight: lambda_d of Eq. 5.
        depth_relief_weight: instead of it, for people whose depth offset is free: what is then left of their depth is
            its relief, which a network makes up more freely than the distance.
        depth_form: "pixels" compares visible vertices with the depth at their pixel; "chamfer" is Eq. 4.
        depth_sigma: expected error of the logarithm of depth.
        depth_loss: robust loss of "pixels".
        depth_scale: its scale, sigmas.
        depth_offset_sigma: prior of log(depth offset) of a person whose feet stand on a known floor; 0 ties depth to
            the scene.
        facing_deg: a vertex faces the camera when its normal is within this angle of the direction to the camera.
        max_human_points: of one person, "chamfer"; more are picked evenly, each standing for several. 0 keeps all.
        contact_weight: lambda_c of Eq. 5.
        contact_probability: a vertex is a contact vertex from this prior probability on.
        contact_reach_m: contact vertices farther from scene and floor are left alone, metres.
        contact_metric: "plane" measures along the surface's normal, "point" to the nearest point.
        contact_sigma_m: expected error of the surface, metres.
        contact_loss: robust loss.
        contact_scale: its scale, sigmas.
        contact_facing: weigh by how squarely the body's surface faces the scene's, so that a sole is pulled down and
            its rim is not.
        contact_occluded: vertices hidden behind objects also touch the scene (they always may touch the floor).
        penetration_weight: lambda_i of Eq. 5.
        penetration_metric: as ``contact_metric``.
        penetration_reach_m: vertices deeper inside are left alone, metres.
        penetration_slack_m: depth that is not punished, metres.
        penetration_sigma_m: expected error of the surface, metres.
        penetration_loss: robust loss.
        penetration_scale: its scale, sigmas.
        occlusion_aware: hidden vertices are left out of penetration and regularised more.
        self_occlusion_share: a limb segment is hidden when this share of its vertices lies behind other parts.
        mask_tolerance: vertices this share of the person outside their mask still count as visible.
        floor: "plane" measures against the fitted plane itself, "points" adds samples of it to the scene, "off" has
            none.
        floor_band_m: scene points this near to the plane are the floor, and left to the plane ("plane").
        floor_weight: of vertices under the plane ("plane").
        floor_slack_m: depth under it that is not punished, metres.
        floor_sigma_m: expected error of the plane, metres.
        sole_weight: of each foot near the floor; the lowest twentieth of the sole is its height.
        sole_sigma_m: expected error of that height, metres.
        sole_scale: beyond this many sigmas a foot is in the air.
        lower_sole_weight: of the lower foot, which is pulled from farther away.
        lower_sole_sigma_m: expected error for it, metres.
        lower_sole_reach_m: farther than this from the floor, and the lower foot is left alone too, metres.
        regularisation_weight: lambda_reg of Eq. 5, over all that follows.
        regularisation_sigma_m: expected error of a visible vertex, root-relative, metres.
        visible_weight: of visible vertices in the mesh's regularisation.
        occluded_weight: of hidden and unobserved ones.
        root_weight: of the root's turn.
        pose_weight: of the other joints' turns.
        hands_weight: of the fingers' turns.
        shape_weight: of the change of shape.
        translation_weight: of the change of place.
        scale_weight: of the change of the scene's scale.
        scale_sigma: expected error of log(scale); the metric depth's own, where it states one, goes first.
        limit_weight: of knees and elbows bent the wrong way or too far.
        balance_weight: of the centre of mass over the feet, along the viewing direction, of people who stand.
    """

    parameters: Literal["whitened", "raw"] = "whitened"
    frozen: tuple[str, ...] = ()
    optimiser: Literal["lbfgs", "adam"] = "lbfgs"
    steps: Count = 80
    refresh_steps: PositiveCount = 20
    learning_rate: Positive = 1e-2
    tolerance: NotNegative = 1e-3
    nearest: Literal["kdtree", "grid", "brute"] = "kdtree"
    nearest_every_step: bool = False
    reduction: Literal["area", "sum"] = "area"
    vertex_spacing_m: NotNegative = 0.02
    reprojection_weight: NotNegative = 1.0
    reprojection_unit: Literal["person", "image"] = "person"
    reprojection_sigma: Positive = 0.01
    reprojection_loss: RobustKind = "cauchy"
    reprojection_scale: Positive = 5.0
    reprojection_mean: bool = False
    min_confidence: Share = 0.3
    low_confidence_weight: NotNegative = 0.1
    depth_weight: NotNegative = 15.0
    depth_relief_weight: NotNegative = 2.0
    depth_form: Literal["pixels", "chamfer"] = "pixels"
    depth_sigma: Positive = 0.03
    depth_loss: RobustKind = "cauchy"
    depth_scale: Positive = 2.0
    depth_offset_sigma: NotNegative = 0.2
    facing_deg: Degrees = 70.0
    max_human_points: Count = 3000
    contact_weight: NotNegative = 1.0
    contact_probability: Share = 0.5
    contact_reach_m: Positive = 0.15
    contact_metric: Literal["plane", "point"] = "plane"
    contact_sigma_m: Positive = 0.02
    contact_loss: RobustKind = "geman_mcclure"
    contact_scale: Positive = 3.0
    contact_facing: bool = True
    contact_occluded: bool = False
    penetration_weight: NotNegative = 0.3
    penetration_metric: Literal["plane", "point"] = "plane"
    penetration_reach_m: Positive = 0.15
    penetration_slack_m: NotNegative = 0.005
    penetration_sigma_m: Positive = 0.02
    penetration_loss: RobustKind = "pseudo_huber"
    penetration_scale: Positive = 2.0
    occlusion_aware: bool = True
    self_occlusion_share: Share = 0.3
    mask_tolerance: NotNegative = 0.01
    floor: Literal["plane", "points", "off"] = "plane"
    floor_band_m: NotNegative = 0.05
    floor_weight: NotNegative = 6.0
    floor_slack_m: NotNegative = 0.0
    floor_sigma_m: Positive = 0.015
    sole_weight: NotNegative = 2.0
    sole_sigma_m: Positive = 0.015
    sole_scale: Positive = 2.0
    lower_sole_weight: NotNegative = 4.0
    lower_sole_sigma_m: Positive = 0.04
    lower_sole_reach_m: Positive = 0.4
    regularisation_weight: NotNegative = 1.0
    regularisation_sigma_m: Positive = 0.06
    visible_weight: NotNegative = 0.05
    occluded_weight: NotNegative = 0.3
    root_weight: NotNegative = 0.3
    pose_weight: NotNegative = 1.0
    hands_weight: NotNegative = 1.0
    shape_weight: NotNegative = 1.0
    translation_weight: NotNegative = 0.05
    scale_weight: NotNegative = 1.0
    scale_sigma: Positive = 0.1
    limit_weight: NotNegative = 1.0
    balance_weight: NotNegative = 16.0


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
        nearest: nearest-point strategy, as in :class:`JointSettings`.
    """

    distance_m: NotNegative = 0.02
    inside_m: NotNegative = 0.05
    reach_m: Positive = 0.15
    metric: Literal["plane", "point"] = "plane"
    facing: bool = False
    observed: bool = True
    nearest: Literal["kdtree", "grid", "brute"] = "kdtree"


@dataclass(frozen=True)
class EngineSettings:
    """What the engine is told: one object per stage."""

    scene: SceneSettings = field(default_factory=SceneSettings)
    human: HumanSettings = field(default_factory=HumanSettings)
    joint: JointSettings = field(default_factory=JointSettings)
    contact: ContactSettings = field(default_factory=ContactSettings)


_PAPER = EngineSettings(
    scene=SceneSettings(
        align_hypotheses=20,
        align_residual="metric",
        intrinsics="pointmap",
        edge_ratio=float("inf"),
        outliers="knn",
        floor="metric",
        floor_hypotheses=200,
        floor_mask_min_share=0.0,
        floor_max_below=1.0,
        floor_reanchor=False,
        floor_grid=100,
        far_m=float("inf"),
    ),
    human=HumanSettings(
        align_hypotheses=20,
        align_residual="metric",
        align_depth_share=0.0,
        mask_dilation=0.0,
        edge_ratio=float("inf"),
        outliers="knn",
        max_points=0,
        solver="adam_lbfgs",
        reduction="sum",
        normalisation="image",
        reprojection_weight=5000.0,
        min_confidence=0.5,
        robust_px_share=float("inf"),
        robust_m=float("inf"),
        depth_offset_sigma=0.0,
        floor_weight=0.0,
    ),
    joint=JointSettings(
        parameters="raw",
        optimiser="adam",
        steps=100,
        refresh_steps=30,
        tolerance=0.0,
        nearest="grid",
        nearest_every_step=True,
        reduction="sum",
        vertex_spacing_m=0.0,
        reprojection_weight=10_000.0,
        reprojection_unit="image",
        reprojection_sigma=1.0,
        reprojection_loss="square",
        reprojection_mean=True,
        min_confidence=0.5,
        low_confidence_weight=0.0,
        depth_weight=0.005,
        depth_form="chamfer",
        depth_offset_sigma=0.0,
        max_human_points=0,
        contact_weight=0.7,
        contact_metric="point",
        contact_sigma_m=1.0,
        contact_loss="barron",
        contact_scale=1.0,
        contact_facing=False,
        contact_occluded=True,
        penetration_weight=0.3,
        penetration_metric="point",
        penetration_slack_m=0.0,
        penetration_sigma_m=1.0,
        penetration_loss="barron",
        penetration_scale=1.0,
        mask_tolerance=0.0,
        floor="points",
        floor_weight=0.0,
        sole_weight=0.0,
        lower_sole_weight=0.0,
        regularisation_weight=45.0,
        regularisation_sigma_m=1.0,
        # The paper weighs hidden vertices higher without saying by how much: these are the released code's numbers.
        visible_weight=0.0,
        occluded_weight=12.0,
        root_weight=50.0,
        pose_weight=0.0,
        hands_weight=0.0,
        shape_weight=0.0,
        translation_weight=1.0,
        scale_weight=1.0,
        limit_weight=0.0,
        balance_weight=0.0,
    ),
    contact=ContactSettings(inside_m=0.15, metric="point", observed=False, nearest="grid"),
)

PRESETS: dict[str, EngineSettings] = {"default": EngineSettings(), "paper": _PAPER}
"""Preset name -> settings: "default" is what measures best, "paper" is the equations and weights as printed."""
