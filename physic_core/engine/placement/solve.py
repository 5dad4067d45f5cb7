"""Stage 2: place the people in the scene (paper Sec. 3.2).

Each body is aligned with its keypoints (Eq. 2) and its points in the scene (Eq. 3-4). In a scene of known size, people
of unknown stature are resized first. OpenCV camera frame, metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.placement.detections import ObservedPeople
from physic_core.engine.placement.human_points import AlignedPhoto, PhotoPoints, align_photo
from physic_core.engine.placement.method import PlacementMethod
from physic_core.engine.placement.place import PeopleObservations, PlacedBodies, Placement, place_bodies
from physic_core.engine.scene.solve import SceneState
from physic_core.engine.sizes import resize_bodies
from physic_core.engine.stance import Stance
from physic_core.types.short_repr import ShortRepr

if TYPE_CHECKING:
    from physic_core.engine.sizes.known_sizes import KnownScene

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
        rotation_sigma: (B, 22) radians, stated errors of the rotations of pelvis and body joints, NaN where unknown;
            None if the estimator states none.
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
        foot_touch: (B, 2) probability that the left and the right foot touch something; None if not requested.
        size_ratio: (B,) factor by which to enlarge people so that a scene of known size matches the photo, NaN where
            unknown; None if the size of the scene is unknown.
    """

    scene: SceneState
    photo: AlignedPhoto
    bodies: EstimatedBodies
    placement: Placement
    foot_touch: Tensor | None
    size_ratio: Tensor | None


def solve_placement(given: PlacementInput, method: PlacementMethod) -> PlacedPeople:
    """Place the people of a photo in their scene."""
    ratio = None
    if given.known is not None and given.known.factor is not None:
        ratio = given.known.factor * _size_by_scene(given, given.known.unscaled, method)
        given = replace(given, bodies=_resized(given.bodies, ratio, given.known.geometry.stature))
    scene, bodies, detections = given.scene, given.bodies, given.detections
    posed = _pose(bodies, detections, method)
    photo = align_photo(given.photo, scene, detections.masks, method)
    stance = given.stance if method.stance else None
    feet_seen = detections.observed[:, _ANKLES].any(1)
    if stance is not None:
        feet_seen = feet_seen & ~torch.from_numpy(stance.in_air).to(feet_seen.device)
    evidence = _observations(detections, photo, feet_seen, method)
    placed = place_bodies(posed, evidence, scene.K, scene.floor_plane, method)
    touch = None if stance is None else torch.from_numpy(stance.touch)
    return PlacedPeople(scene, photo, bodies, placed, touch, ratio)


def _pose(bodies: EstimatedBodies, detections: ObservedPeople, method: PlacementMethod) -> PlacedBodies:
    """Pose the bodies, with the landmarks of the keypoints that stage 2 uses."""
    model = bodies.model
    output = model(bodies.rotations, bodies.betas, bodies.transl, bodies.expression)
    landmarks = model.landmarks(output, detections.skeleton)
    return PlacedBodies(
        vertices=output.vertices,
        normals=method.normals(output.vertices, model.faces),
        landmarks=landmarks[:, method.keypoint_columns(detections.skeleton)],
        transl=bodies.transl,
        outer=model.outer,
        soles=model.soles,
    )


def _observations(
    detections: ObservedPeople, photo: AlignedPhoto, feet_seen: Tensor, method: PlacementMethod
) -> PeopleObservations:
    """Return the keypoints that stage 2 uses, with their weights, and the points of the people."""
    skeleton, keypoints = detections.skeleton, detections.keypoints
    columns = method.keypoint_columns(skeleton)
    weight = method.weigh_keypoints(skeleton, keypoints, detections.confidence, detections.masks.to(keypoints.device))
    return PeopleObservations(
        keypoints=keypoints[:, columns],
        confidence=weight[:, columns],
        points=photo.people,
        masks=detections.masks,
        feet_seen=feet_seen,
    )


def _size_by_scene(given: PlacementInput, scene: SceneState, method: PlacementMethod) -> Tensor:
    """Return :func:`size_by_scene` (B,) of the bodies placed at their keypoints.

    Args:
        scene: before applying known sizes, when bodies and scene roughly agree.
    """
    posed = _pose(given.bodies, given.detections, method)
    photo = align_photo(given.photo, scene, given.detections.masks, method)
    feet_seen = given.detections.observed[:, _ANKLES].any(1)
    evidence = _observations(given.detections, photo, feet_seen, method)
    placed = place_bodies(posed, evidence, scene.K, scene.floor_plane, method)
    from physic_core.engine.sizes.people_in_scene import size_by_scene

    vertices = posed.vertices + (placed.keypoint_transl.to(posed.transl) - posed.transl)[:, None]
    on_floor = [person.on_floor for person in placed.people]
    return size_by_scene(vertices, given.bodies.model.soles, on_floor, scene.floor_plane, photo.people)


def _resized(bodies: EstimatedBodies, ratio: Tensor, known_stature: Tensor) -> EstimatedBodies:
    """Resize people of unknown stature by the factors (B,) of :func:`size_by_scene`."""
    from physic_core.engine.sizes.stature import stature_factor

    own = bodies.model.stature(bodies.betas)
    wanted = torch.where(torch.isfinite(known_stature.to(own)), own, own * stature_factor(ratio, own))
    parts = (bodies.rotations.flatten(1), bodies.betas, bodies.expression, bodies.transl)
    finite = torch.isfinite(torch.cat(parts, 1)).all(1)
    wanted = torch.where(finite, wanted, torch.nan)
    betas, transl, _ = resize_bodies(bodies.model, bodies.rotations, bodies.betas, bodies.transl, wanted)
    return replace(bodies, betas=betas, transl=transl)
