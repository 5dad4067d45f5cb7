"""Stage 2: place the people in the scene (paper Sec. 3.2).

The point map of the original photo is aligned to the scene on the background, which gives the 3D
points of each person. Each body is aligned with its keypoints (Eq. 2) and these points (Eq. 3-4).
In a scene of known size, people of unknown stature are resized first. OpenCV camera frame, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.placement.method import PlacementMethod
from physic_core.engine.placement.place import (
    ObservedPeople,
    PeopleObservations,
    PlacedBodies,
    Placement,
    place_bodies,
)
from physic_core.engine.scene.solve import SceneState
from physic_core.engine.sizes.stature import resize_bodies
from physic_core.engine.stance import Stance
from physic_core.geometry.alignment import Alignment, apply_alignment, fit_alignment
from physic_core.geometry.pointmap import depth_to_pointmap
from physic_core.geometry.tensors import all_finite
from physic_core.types import AffineAmbiguity
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.engine.sizes.known_sizes import KnownScene


FAR_M = 50.0
"""Maximum background depth used by the alignment, metres."""

_MARGIN_PX = 8


@dataclass(frozen=True)
class PhotoPoints:
    """Point map of the original photo.

    Attributes:
        points: (H, W, 3) any unit.
        valid: (H, W) bool.
        unknown: its ambiguity relative to the scene: scale, or scale and z-shift.
        people: (H, W) bool, pixels of all people.
    """

    points: Tensor
    valid: Tensor
    unknown: AffineAmbiguity
    people: Tensor


@dataclass(frozen=True)
class AlignedPhoto:
    """Point map of the original photo, aligned to the scene.

    Attributes:
        alignment: of its background to the scene.
        points: (H, W, 3) metres; all NaN if no background pixel agrees.
        valid: (H, W) bool.
        people: per person (M_i, 3) metres, human points.
    """

    alignment: Alignment
    points: Tensor
    valid: Tensor
    people: tuple[Tensor, ...]

    @property
    def depth(self) -> Tensor:
        """Depth map (H, W), metres along z, NaN where unknown."""
        return torch.where(self.valid & all_finite(self.points), self.points[..., 2], torch.nan)


def align_photo(
    photo: PhotoPoints, scene: SceneState, masks: Tensor, method: PlacementMethod
) -> AlignedPhoto:
    """Align the photo to the metric scene, and select the points of people with masks (B, H, W)
    bool.
    """
    alignment = align_photo_points_to_scene(photo, scene.points, scene.valid, method, far=FAR_M)
    aligned = move_photo_points_to_scene(photo.points, alignment, scene.K)
    people = tuple(human_points(aligned, photo.valid, mask, method) for mask in masks)
    return AlignedPhoto(alignment, aligned, photo.valid, people)


def align_photo_points_to_scene(
    photo: PhotoPoints,
    scene_points: Tensor,
    scene_valid: Tensor,
    method: PlacementMethod | None = None,
    far: float = math.inf,
) -> Alignment:
    """Align the original photo's point map to the scene's point map on background pixels (Eq. 1).

    Args:
        photo: point map of the original photo.
        scene_points: (H, W, 3) point map of the scene, any unit.
        scene_valid: (H, W) bool.
        method: of stage 2; that of preset "default" if None.
        far: largest depth of scene pixels used, in the unit of the scene; ``FAR_M`` for a metric
            scene.

    Returns:
        The alignment; ``inlier_share`` is 0 without common pixels.
    """
    method = method or PlacementMethod()
    background = ~method.grow_mask(photo.people) & (scene_points[..., 2] <= far)
    return fit_alignment(
        photo.points,
        scene_points,
        photo.valid & scene_valid & background,
        photo.unknown,
        options=method.alignment,
        weight=method.weigh_background(photo.points[..., 2], photo.valid, photo.people, background),
    )


def move_photo_points_to_scene(points: Tensor, alignment: Alignment, K: Tensor | None) -> Tensor:
    """Apply the alignment to the original photo's point map; if ``K`` (3, 3) is given, move points
    onto rays of ``K``.

    Returns:
        (H, W, 3) metres; NaN if the alignment has no inliers, since the distance of people is then
        unknown.
    """
    if alignment.inlier_share == 0:
        return torch.full_like(points, math.nan)
    aligned = apply_alignment(points, alignment)
    return aligned if K is None else depth_to_pointmap(aligned[..., 2], K)


def human_points(
    points: Tensor, valid: Tensor, mask: Tensor, method: PlacementMethod | None = None
) -> Tensor:
    """Return the points of one person, without depth edges and outliers.

    Args:
        points: (H, W, 3) metres, of the original photo, aligned to the scene.
        valid: (H, W) bool.
        mask: (H, W) bool, the person's visible pixels.
        method: of stage 2; that of preset "default" if None.

    Returns:
        (M, 3) metres; M = 0 if the mask has no valid point.
    """
    box = _box(mask)
    if box is None:
        return points.new_zeros((0, 3))
    cloud = points[box]
    inside = mask[box]
    known = valid[box] & all_finite(cloud) & (cloud[..., 2] > 0)
    cloud = torch.where(known[..., None], cloud, 0.0)
    return (method or PlacementMethod()).clean_points(cloud, known, inside, mask.shape)


def _box(mask: Tensor) -> tuple[slice, slice] | None:
    """Return rows and columns of a mask's bounding box with a margin, or None for an empty mask."""
    if not bool(mask.any()):
        return None
    spans = []
    for dim, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        hit = mask.any(dim).nonzero()
        spans.append(
            slice(max(0, int(hit[0]) - _MARGIN_PX), min(size, int(hit[-1]) + 1 + _MARGIN_PX))
        )
    return spans[0], spans[1]


_ANKLES = joint_pair("ankle")


@dataclass(frozen=True)
class EstimatedBodies(ShortRepr):
    """B bodies of the body estimator, in the floating-point type and on the device of the model.

    Attributes:
        model: of all bodies.
        rotations: (B, 55, 3, 3).
        betas: (B, K).
        expression: (B, E).
        transl: (B, 3) metres.
        rotation_sigma: (B, 22) radians, stated errors of the rotations of pelvis and body joints,
            NaN where unknown; None if the estimator states none.
    """

    model: BodyModel
    rotations: Tensor
    betas: Tensor
    expression: Tensor
    transl: Tensor
    rotation_sigma: Tensor | None = None


@dataclass(frozen=True)
class PlacementInput(ShortRepr):
    """Estimates of the B people of a photo, and their scene.

    Attributes:
        scene: of stage 1, in metres.
        photo: point map of the photo with its people.
        bodies: as estimated.
        detections: of the same people; each keypoint has a landmark on the body.
        known: sizes that the user knows; None without any.
        stance: of the people; None if unknown.
    """

    scene: SceneState
    photo: PhotoPoints
    bodies: EstimatedBodies
    detections: ObservedPeople
    known: KnownScene | None = None
    stance: Stance | None = None


@dataclass(frozen=True)
class PlacedPeople(ShortRepr):
    """People in their scene.

    Attributes:
        scene: that of the input.
        photo: its point map, aligned to the scene.
        bodies: as estimated, or resized to a scene of known size.
        placement: of the bodies.
        foot_touch: (B, 2) probability that the left and the right foot touch something; None if not
            requested.
        size_ratio: (B,) factor by which to enlarge people so that a scene of known size matches the
            photo, NaN where unknown; None if the size of the scene is unknown.
    """

    scene: SceneState
    photo: AlignedPhoto
    bodies: EstimatedBodies
    placement: Placement
    foot_touch: Tensor | None
    size_ratio: Tensor | None


def solve_placement(given: PlacementInput, method: PlacementMethod) -> PlacedPeople:
    """Place the people of a photo in their scene."""
    feet_seen = given.detections.observed[:, _ANKLES].any(1)
    ratio = None
    if given.known is not None and given.known.factor is not None:
        ratio = given.known.factor * _size_by_scene(given, given.known.unscaled, feet_seen, method)
        given = replace(given, bodies=_resized(given.bodies, ratio, given.known.geometry.stature))
    stance = given.stance if method.stance else None
    if stance is not None:
        feet_seen = feet_seen & ~torch.from_numpy(stance.in_air).to(feet_seen.device)
    _, photo, placed = _place(given, given.scene, feet_seen, method)
    touch = None if stance is None else torch.from_numpy(stance.touch)
    return PlacedPeople(given.scene, photo, given.bodies, placed, touch, ratio)


def _place(
    given: PlacementInput, scene: SceneState, feet_seen: Tensor, method: PlacementMethod
) -> tuple[PlacedBodies, AlignedPhoto, Placement]:
    """Pose the bodies, align the photo with a scene, and place the bodies in it."""
    bodies = given.bodies
    detections = given.detections
    model = given.bodies.model
    skeleton = detections.skeleton
    keypoints = detections.keypoints
    columns = method.keypoint_columns(skeleton)
    output = model(bodies.rotations, bodies.betas, bodies.transl, bodies.expression)
    posed = PlacedBodies(
        vertices=output.vertices,
        normals=method.normals(output.vertices, model.faces),
        landmarks=model.landmarks(output, skeleton)[:, columns],
        transl=bodies.transl,
        outer=model.outer,
        soles=model.soles,
    )
    photo = align_photo(given.photo, scene, detections.masks, method)
    weight = method.weigh_keypoints(
        skeleton, keypoints, detections.confidence, detections.masks.to(keypoints.device)
    )
    evidence = PeopleObservations(
        keypoints=keypoints[:, columns],
        confidence=weight[:, columns],
        points=photo.people,
        masks=detections.masks,
        feet_seen=feet_seen,
    )
    return posed, photo, place_bodies(posed, evidence, scene.K, scene.floor_plane, method)


def _size_by_scene(
    given: PlacementInput, scene: SceneState, feet_seen: Tensor, method: PlacementMethod
) -> Tensor:
    """Return :func:`size_by_scene` (B,) of the bodies placed at their keypoints.

    Args:
        scene: before applying known sizes, when bodies and scene roughly agree.
    """
    from physic_core.engine.sizes.known_sizes import size_by_scene

    posed, photo, placed = _place(given, scene, feet_seen, method)
    vertices = posed.vertices + (placed.keypoint_transl.to(posed.transl) - posed.transl)[:, None]
    return size_by_scene(
        vertices, given.bodies.model.soles, placed.on_floor, scene.floor_plane, photo.people
    )


def _resized(bodies: EstimatedBodies, ratio: Tensor, known_stature: Tensor) -> EstimatedBodies:
    """Resize people of unknown stature by the factors (B,) of :func:`size_by_scene`."""
    from physic_core.engine.sizes.stature import stature_factor

    own = bodies.model.stature(bodies.betas)
    wanted = torch.where(
        torch.isfinite(known_stature.to(own)), own, own * stature_factor(ratio, own)
    )
    parts = (bodies.rotations.flatten(1), bodies.betas, bodies.expression, bodies.transl)
    finite = torch.isfinite(torch.cat(parts, 1)).all(1)
    wanted = torch.where(finite, wanted, torch.nan)
    betas, transl, _ = resize_bodies(
        bodies.model, bodies.rotations, bodies.betas, bodies.transl, wanted
    )
    return replace(bodies, betas=betas, transl=transl)
