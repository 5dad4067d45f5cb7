"""Every number that stage 3 can be told; its defaults are preset "default"."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from physic_core.engine.bounds import (
    Count,
    Degrees,
    NearestStrategy,
    NotNegative,
    Positive,
    PositiveCount,
    RobustKind,
    Share,
)

__all__ = ["JointSettings"]


@dataclass(frozen=True)
class JointSettings:
    """Stage 3: pose, hands, shape, translation and scene scale together (paper Sec. 3.3, Eq. 5-7).

    A residual is divided by its "sigma", how far it may be off, and goes through a robust loss whose "scale" is in
    sigmas: beyond it a residual counts as an outlier. Losses: "square", "pseudo_huber" (constant pull), "cauchy"
    (ever weaker), "geman_mcclure" (lets go), "barron" (half a pseudo-Huber, as published). A weight of 0 switches a
    term off.

    Attributes:
        parameters: "whitened" deviations in units of their expected size, or the "raw" numbers themselves.
        frozen: groups that stay as they are: root, pose, hands, betas, translation, scale, offset, warp.
        optimiser: "lbfgs" with a backtracking (Armijo) line search, or "adam".
        steps: at most; 40-100.
        refresh_steps: steps between two looks at visibility and, with "lbfgs", nearest points; 10-30.
        learning_rate: Adam's.
        tolerance: stop when a refresh's steps lower the energy by less than this share; 0 never stops early.
        scene_after: contact, penetration and floor join after this share of the steps; 0 from the beginning.
        starts: of each person's pose and place, the best of which is kept: 1 is the body estimator's alone, 3 adds
            the body tilted by 15 degrees to either side about the camera's horizontal axis, 5 adds it 10 % nearer and
            farther as well. Whitened parameters only.
        start_doubt: other starts are tried for people whose keypoints are still off at the end, by this share of the
            person; 0 tries them for everybody.
        nearest: nearest-point strategy, "kdtree" (exact), "grid" (the paper's 128^3 cells) or "brute".
        nearest_every_step: look up nearest points at every evaluation and not only at a refresh.
        reduction: "area" weighs each vertex by the surface that it stands for, in units of a square decimetre, so that
            every mesh gives the same energy; "sum" counts vertices, as printed, contact vertices too whatever their
            probability.
        vertex_spacing_m: vertices that touch nothing are thinned to this spacing, metres; 0 keeps all.
        observed: limbs that the photo does not show take no part in depth, contact and penetration; False takes all as
            shown.
        visibility: "own" looks at each person's own mask, at every refresh. "released" takes all masks as one, looks at
            masks and camera-facing vertices once, and has rules of its own for normals and hidden limbs.
        reprojection_weight: lambda_j2d of Eq. 5.
        reprojection_form: "robust", as the settings that follow say, or "released": weights of keypoints, absolute
            errors and their mean as in the released code.
        reprojection_unit: 2D errors are shares of the "person" (stature in px) or of the "image" (width and height),
            or pixels of a picture that is 1920 px long ("full_hd").
        reprojection_sigma: expected error in that unit; 0.01 of a person.
        reprojection_loss: robust loss.
        reprojection_scale: its scale, sigmas.
        reprojection_per_axis: the robust loss takes each axis by itself, instead of their distance.
        confidence_power: keypoints count by this power of their confidence; 1, or 2 as in PROX.
        min_confidence: keypoints below count ``low_confidence_weight`` times as much.
        low_confidence_weight: 0 drops them.
        unseen_keypoint_weight: keypoints on limbs that the photo does not show count so much, by their confidence:
            detectors put them where the rest of the body lets expect them; 0 leaves such limbs to the start.
        depth_weight: lambda_d of Eq. 5.
        depth_relief_weight: instead of it, for people whose depth offset is free: what is then left of their depth is
            its relief, which a network makes up more freely than the distance.
        depth_form: "pixels" compares visible vertices with the depth at their pixel; "chamfer" is Eq. 4.
        depth_sigma: expected error of the logarithm of depth.
        depth_loss: robust loss of "pixels".
        depth_scale: its scale, sigmas.
        depth_offset_sigma: prior of log(depth offset) of a person whose feet stand on a known floor; 0 ties depth to
            the scene.
        depth_offset_alone_sigma: the same of all other people.
        facing_deg: a vertex faces the camera when its normal is within this angle of the direction to the camera.
        max_human_points: of one person, "chamfer"; more are picked evenly, each standing for several. 0 keeps all.
        scene_unit: distances to scene and floor count in "metres", which makes a smaller scene with smaller people a
            better one, since all that is off is less off in it, or in the "scene"'s own unit, which scales with it.
        contact_weight: lambda_c of Eq. 5.
        contact_source: who may touch: the contact "prior", or "static" parts of every body: feet, hands, thighs, seat
            and back.
        contact_static_weight: static parts, where the prior does not see them touch, count by this weight; 0 leaves all
            to the prior.
        contact_probability: a vertex is a contact vertex from this prior probability on.
        contact_reach_m: contact vertices farther from scene and floor are left alone, metres.
        contact_metric: "plane" measures along the surface's normal, "point" to the nearest point; "axes" takes the
            robust loss of each axis of the way to it by itself (released code).
        contact_sigma_m: expected error of the surface, metres.
        contact_loss: robust loss.
        contact_scale: its scale, sigmas.
        contact_facing: weigh by how squarely the body's surface faces the scene's, so that a sole is pulled down and
            its rim is not.
        contact_angle_deg: a vertex touches only where its normal and the scene's lie within this angle of one line,
            either way round; 90 asks nothing.
        contact_outside: only vertices over the surface are pulled to it, those inside are not (released code).
        contact_mean: over the vertices that touch, instead of the sum.
        free_space: what lies before all that the depth map shows is inside nothing, whatever the nearest point's normal
            says.
        penetration_weight: lambda_i of Eq. 5.
        penetration_metric: as ``contact_metric``.
        penetration_reach_m: vertices deeper inside are left alone, metres.
        penetration_slack_m: depth that is not punished, metres.
        penetration_sigma_m: expected error of the surface, metres.
        penetration_loss: robust loss.
        penetration_scale: its scale, sigmas.
        penetration_self_occluded: vertices that only the own body hides may not penetrate either.
        penetration_spares_contact: contact vertices may penetrate (released code).
        occlusion_aware: hidden vertices are left out of penetration and regularised more.
        self_occlusion_share: a limb segment is hidden when this share of its vertices lies behind other parts.
        self_occlusion_mesh: "full", or "coarse": vertices 2 cm apart, each for those round it.
        mask_tolerance: vertices this share of the person outside their mask still count as visible.
        floor: "plane" measures against the fitted plane itself, "points" adds samples of it to the scene, "off" has
            none.
        floor_band_m: scene points this near to the plane are the floor, and left to the plane ("plane").
        floor_weight: of vertices under the plane ("plane").
        floor_unseen_share: of it, for limbs that the photo does not show.
        floor_sigma_m: expected error of the plane, metres.
        sole_weight: of each foot near the floor; the lowest twentieth of the sole is its height.
        sole_sigma_m: expected error of that height, metres.
        sole_scale: beyond this many sigmas a foot is in the air.
        lower_sole_weight: of the lower foot, which is pulled from farther away.
        lower_sole_sigma_m: expected error for it, metres.
        unseen_sole_weight: of each foot that the photo does not show: most feet stand on the floor.
        unseen_sole_sigma_m: how far they may be off, metres; feet four times as far are left alone.
        lower_sole_reach_m: farther than this from the floor, and the lower foot is left alone too, metres.
        regularisation_weight: lambda_reg of Eq. 5, over all that follows.
        regularisation_form: "own" takes the mesh relative to its pelvis, and translation from the start. "released"
            takes the mesh without root rotation, its pelvis moving with the shape, and translation from where the body
            estimator put it.
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
        warp_sigma: expected error of the logarithm of the depth of what is round a person, beside that of the whole
            scene; 0 leaves the scene as it is.
        limit_weight: of knees and elbows bent the wrong way or too far.
        balance_weight: of the centre of mass over the feet, along the viewing direction, of people who stand and lean
            on nothing.
        unseen_symmetry_weight: of unlike legs, where the photo shows neither knees nor ankles: left and right are more
            likely alike than an estimator guesses.
        stature_weight: of the stature's change, which with ``scale_weight`` decides whether people or scene give way
            where their sizes disagree.
        stature_sigma: expected error of log(stature), beside the 0.054 that ``shape_weight`` 1 stands for with the
            embedded body: 0.06 makes 0.04 of the two.
    """

    parameters: Literal["whitened", "raw"] = "whitened"
    frozen: tuple[str, ...] = ()
    optimiser: Literal["lbfgs", "adam"] = "lbfgs"
    steps: Count = 80
    refresh_steps: PositiveCount = 20
    learning_rate: Positive = 1e-2
    tolerance: NotNegative = 5e-3
    scene_after: Share = 0.0
    starts: Literal[1, 3, 5] = 3
    start_doubt: NotNegative = 0.04
    nearest: NearestStrategy = "kdtree"
    nearest_every_step: bool = False
    reduction: Literal["area", "sum"] = "area"
    vertex_spacing_m: NotNegative = 0.02
    observed: bool = True
    visibility: Literal["own", "released"] = "own"
    reprojection_weight: NotNegative = 1.0
    reprojection_form: Literal["robust", "released"] = "robust"
    reprojection_unit: Literal["person", "image", "full_hd"] = "person"
    reprojection_sigma: Positive = 0.01
    reprojection_loss: RobustKind = "cauchy"
    reprojection_scale: Positive = 5.0
    reprojection_per_axis: bool = False
    confidence_power: Positive = 1.0
    min_confidence: Share = 0.3
    low_confidence_weight: NotNegative = 0.1
    unseen_keypoint_weight: NotNegative = 0.4
    depth_weight: NotNegative = 15.0
    depth_relief_weight: NotNegative = 2.0
    depth_form: Literal["pixels", "chamfer"] = "pixels"
    depth_sigma: Positive = 0.03
    depth_loss: RobustKind = "cauchy"
    depth_scale: Positive = 2.0
    depth_offset_sigma: NotNegative = 0.2
    depth_offset_alone_sigma: NotNegative = 0.03
    facing_deg: Degrees = 70.0
    max_human_points: Count = 3000
    scene_unit: Literal["metres", "scene"] = "scene"
    contact_weight: NotNegative = 1.25
    contact_source: Literal["prior", "static"] = "prior"
    contact_static_weight: NotNegative = 0.4
    contact_probability: Share = 0.5
    contact_reach_m: Positive = 0.15
    contact_metric: Literal["plane", "point", "axes"] = "plane"
    contact_sigma_m: Positive = 0.02
    contact_loss: RobustKind = "geman_mcclure"
    contact_scale: Positive = 3.5
    contact_facing: bool = True
    contact_angle_deg: Degrees = 90.0
    contact_outside: bool = False
    contact_mean: bool = False
    free_space: bool = True
    penetration_weight: NotNegative = 0.3
    penetration_metric: Literal["plane", "point", "axes"] = "plane"
    penetration_reach_m: Positive = 0.15
    penetration_slack_m: NotNegative = 0.005
    penetration_sigma_m: Positive = 0.02
    penetration_loss: RobustKind = "pseudo_huber"
    penetration_scale: Positive = 2.0
    penetration_self_occluded: bool = False
    penetration_spares_contact: bool = False
    occlusion_aware: bool = True
    self_occlusion_share: Share = 0.3
    self_occlusion_mesh: Literal["coarse", "full"] = "coarse"
    mask_tolerance: NotNegative = 0.01
    floor: Literal["plane", "points", "off"] = "plane"
    floor_band_m: NotNegative = 0.05
    floor_weight: NotNegative = 6.0
    floor_unseen_share: Share = 0.3
    floor_sigma_m: Positive = 0.015
    sole_weight: NotNegative = 2.0
    sole_sigma_m: Positive = 0.015
    sole_scale: Positive = 2.0
    lower_sole_weight: NotNegative = 4.0
    lower_sole_sigma_m: Positive = 0.04
    unseen_sole_weight: NotNegative = 4.0
    unseen_sole_sigma_m: Positive = 0.05
    lower_sole_reach_m: Positive = 0.4
    regularisation_weight: NotNegative = 1.0
    regularisation_form: Literal["own", "released"] = "own"
    regularisation_sigma_m: Positive = 0.06
    visible_weight: NotNegative = 0.01
    occluded_weight: NotNegative = 0.05
    root_weight: NotNegative = 0.3
    pose_weight: NotNegative = 1.0
    hands_weight: NotNegative = 1.0
    shape_weight: NotNegative = 1.0
    translation_weight: NotNegative = 0.05
    scale_weight: NotNegative = 1.5
    scale_sigma: Positive = 0.1
    warp_sigma: NotNegative = 0.1
    limit_weight: NotNegative = 1.0
    balance_weight: NotNegative = 16.0
    unseen_symmetry_weight: NotNegative = 2.0
    stature_weight: NotNegative = 1.0
    stature_sigma: Positive = 0.06
