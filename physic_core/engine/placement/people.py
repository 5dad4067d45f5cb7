"""Stage 2 for all people of a photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.engine.joint.limbs import detected_joints
from physic_core.engine.placement.place import PeopleObservations, PersonPlacement, Placement, PosedBodies, place_bodies
from physic_core.engine.placement.settings import PlacementSettings
from physic_core.types import Skeleton

__all__ = ["Detections", "observed_joints", "place_people"]

_ANKLES = joint_pair("ankle")


@dataclass(frozen=True)
class Detections:
    """Results of detectors and estimators for B people.

    Attributes:
        skeleton: of the J keypoints.
        keypoints: (B, J, 2) px.
        confidence: (B, J) in [0, 1].
        observed: (B, 55) bool, joints that the body estimator reports as visible; None means all.
        points: B tensors (M_i, 3) metres, the people's points in the scene.
        masks: (B, H, W) bool, visible pixels of each person.
        airborne: (B,) bool, people with both feet in the air; None if unknown, which counts as no such person.
    """

    skeleton: Skeleton
    keypoints: Tensor
    confidence: Tensor
    observed: Tensor | None
    points: Sequence[Tensor]
    masks: Tensor
    airborne: Tensor | None = None


def place_people(
    bodies: PosedBodies,
    detections: Detections,
    K: Tensor,
    floor: tuple[Tensor, float] | None,
    settings: PlacementSettings,
    before: Placement | None = None,
) -> Placement:
    """Place B posed bodies.

    Args:
        bodies: as estimated, with one landmark for each keypoint.
        detections: of the B people.
        K: (3, 3) px.
        floor: normal (3,) and offset, or None.
        settings: of stage 2.
        before: result with another floor; people whose placement does not depend on the floor are reused.
    """
    columns = settings.method().keypoint_columns(detections.skeleton)
    used = replace(bodies, landmarks=bodies.landmarks[:, columns])
    known: list[PersonPlacement | None] = [None] * len(bodies.transl)
    if before is not None:
        known = [None if person.on_floor else person for person in before.people]
    return place_bodies(used, _evidence(detections, columns, settings), K, floor, settings, known)


def _evidence(detections: Detections, columns: list[int], settings: PlacementSettings) -> PeopleObservations:
    masks = detections.masks.to(detections.confidence.device)
    weight = settings.method().weigh_keypoints(detections.skeleton, detections.keypoints, detections.confidence, masks)
    feet_seen = observed_joints(detections, settings)[:, _ANKLES].any(1)
    if detections.airborne is not None:
        feet_seen = feet_seen & ~detections.airborne.to(feet_seen.device)
    return PeopleObservations(
        keypoints=detections.keypoints[:, columns],
        confidence=weight[:, columns],
        points=detections.points,
        masks=detections.masks,
        feet_seen=feet_seen,
    )


def observed_joints(detections: Detections, settings: PlacementSettings) -> Tensor:
    """Return the joints (B, 55) bool that the body estimator or a confident keypoint reports as visible."""
    keypoints = detections.keypoints
    reported = detections.observed
    if reported is None:
        reported = torch.ones((len(keypoints), len(JOINT_INDEX)), dtype=torch.bool)
    return reported.to(keypoints.device) | detected_joints(
        detections.skeleton,
        keypoints,
        detections.confidence,
        detections.masks.to(keypoints.device),
        settings.seen_confidence,
    )
