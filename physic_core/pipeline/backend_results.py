"""Prepare results of backends: for the configured body model, and without invalid people.

Functions on invalid people take a checked result, so that the pipeline continues with the other
people. They return the result with the rows of people with invalid numbers replaced by values for
"unknown", and a mask (N,) bool of them.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.backends.people import SAME_PERSON, keypoint_similarity
from physic_core.body.joints import joint_pair
from physic_core.errors import BodyModelError, ConfigError
from physic_core.interfaces.bodies import valid_body_rows, valid_contact_rows, valid_hand_rows
from physic_core.interfaces.people import valid_keypoint_rows
from physic_core.pipeline.plausibility import implausible_wrists
from physic_core.types import BodyParameters
from physic_core.types.arrays import select_people
from physic_core.types.observations import LEAST_PROBABILITY

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.configuration.resolve import ResolvedBackend
    from physic_core.pipeline.stage_caller import StageCaller
    from physic_core.types import (
        Bodies,
        BoolArray,
        ContactProbability,
        FloatArray,
        Hands,
        Keypoints,
        People,
        PeoplePrompt,
    )

_JOINTS = ("nose", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
# A false person had .27 of the joints on the own mask and .73 on that of another person. Of 201
# people in 37 photos of crowds one had .13 and .53, one .30 and .30, and the others at least .35
# and at most .40.
_FEW_OWN_JOINTS = 0.3  # share on the own mask
_MOST_JOINTS = 0.6  # share on that of another person
# Of 296 people in 67 photos none has less than .31, or is nearer than .70.
_VISIBLE = 0.25  # least area of a mask over its joints' hull, with most joints on another mask
_MOST_CONTACT = 0.6  # share of the vertices; worlds with contact have at most .25


def is_real_person(people: People, prompt: PeoplePrompt | None = None) -> BoolArray:
    """Return which people (N,) bool are real, by the keypoints of the segmenter: all without
    keypoints or with masks.

    A false person has most joints on the mask of another one, and few on its own or a mask much
    smaller than its joints; of a real person behind another one, the photo shows more. Or it has
    the pose of another one of whom the photo shows more, or else whose score is higher.
    """
    keypoints = people.keypoints
    count = len(people)
    if keypoints is None or count < 2 or (prompt is not None and prompt.masks is not None):
        return np.ones(count, bool)
    names = [name.removesuffix("_surface") for name in keypoints.joint_set.names]
    columns = [j for j, name in enumerate(names) if name.split("_")[-1] in _JOINTS]
    share, small = _joints_on_masks(keypoints.points[:, columns], people.masks)
    own_share = np.diag(share)
    few = own_share < _FEW_OWN_JOINTS
    similar = keypoint_similarity(keypoints.points, keypoints.confidence, names) > SAME_PERSON
    rank = np.lexsort((-people.scores, few | small)).argsort()
    double = (similar & (rank[:, None] > rank)).any(1)
    none = np.eye(count, dtype=bool) | few | small | double
    others = np.where(none, 0.0, share).max(1)
    false: BoolArray = double | (few & (others > _MOST_JOINTS)) | (small & (others > own_share))
    return ~false


def _joints_on_masks(points: FloatArray, masks: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the share (N, N) of each person's joints (N, J, 2) in the photo that lie on each mask,
    and whose mask (N,) is much smaller than the joints' hull.
    """
    import cv2

    height, width = masks.shape[1:]
    x, y = np.moveaxis(points, -1, 0).round()
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    rows, across = (np.where(inside, values, 0).astype(int) for values in (y, x))
    on_mask = np.array([(mask[rows, across] & inside).sum(1) for mask in masks])
    hulls = [
        cv2.contourArea(cv2.convexHull(own[known].astype(np.float32))) if known.any() else 0.0
        for own, known in zip(points, inside, strict=True)
    ]
    share = on_mask.T / np.maximum(inside.sum(1), 1)[:, None]
    return share, masks.sum((1, 2)) < _VISIBLE * np.array(hulls)


def replace_hands(bodies: Bodies, hands: Hands, model: BodyModel) -> Bodies:
    """Replace the finger rotations of bodies by those of ``hands`` where their confidence is above
    0.

    If ``hands.wrists`` are given, forearms and wrists are rotated to fit the hands, weighted by
    confidence.
    """
    if hands.wrists is not None:
        from physic_core.body.attach_hands import attach_hands

        return replace(bodies, parameters=attach_hands(bodies.parameters, hands, model))
    p = bodies.parameters
    has_hand = hands.confidence > 0
    flat = hands.rotvecs.reshape(len(p), 2, 45).astype(p.left_hand_pose.dtype)
    left = np.where(has_hand[:, :1], flat[:, 0], p.left_hand_pose)
    right = np.where(has_hand[:, 1:], flat[:, 1], p.right_hand_pose)
    return replace(bodies, parameters=replace(p, left_hand_pose=left, right_hand_pose=right))


def without_implausible_wrists(
    hands: Hands, bodies: Bodies, backend: ResolvedBackend, stages: StageCaller
) -> Hands:
    """Return hands without wrists, and with a warning, if these are far from the wrists of the
    bodies and the backend never passed the kit.
    """
    if hands.wrists is None or stages.has_passed_kit(backend):
        return hands
    from physic_core.body.attach_hands import wrist_turns_deg

    warning = implausible_wrists(hands, wrist_turns_deg(bodies.parameters, hands.wrists))
    if not warning:
        return hands
    stages.warn(f"{backend.title}: {warning}")
    return replace(hands, wrists=None)


def convert_to_configured(
    bodies: Bodies, model: BodyModel, title: str, stages: StageCaller
) -> Bodies:
    """Convert bodies to the configured body model, and add a note with the conversion error.

    Raises:
        ConfigError: the bodies have neither joints nor mesh.
        BodyModelError: they have too few joints for all people.
    """
    from physic_core.conversion import can_convert, convert_bodies

    if not can_convert(bodies, model):
        cure = (
            "name = 'embedded'"
            if bodies.body_model == "embedded"
            else f"path = the file of a '{bodies.body_model}'"
        )
        raise ConfigError(
            f"{title} gives bodies for the body model '{bodies.body_model}', "
            f"but the configuration loads '{model.name}': set [body_model] {cure}, "
            f"or choose a body_estimator that gives '{model.name}'"
        )
    try:
        converted = convert_bodies(bodies, model)
    except BodyModelError as error:
        raise BodyModelError(f"{title}: {error}") from error
    if not valid_body_rows(converted.bodies).any():
        raise BodyModelError(
            f"{title} gives bodies for the body model '{bodies.body_model}' with too few joints to "
            f"convert them to "
            f"'{model.name}': both hips, and both shoulders or the neck, are needed for at least "
            f"one person"
        )
    stages.note(converted.note(bodies.body_model))
    return converted.bodies


def transfer_contact(
    contact: ContactProbability, model: BodyModel, title: str, stages: StageCaller
) -> ContactProbability | None:
    """Transfer contact probabilities to the mesh of the configured body model; None and a warning
    on failure.
    """
    from physic_core.conversion import convert_contact

    try:
        carried = convert_contact(contact, model)
    except BodyModelError as error:
        stages.warn(f"{title}: {error}; contact is computed from distances only")
        return None
    stages.note(f"contact transferred from the mesh '{contact.topology}' to '{model.topology}'")
    return carried


def discard_invalid_keypoints(keypoints: Keypoints) -> tuple[Keypoints, BoolArray]:
    """Set the confidence of people with invalid keypoints to 0, and of people with 3D points none
    of which was seen.

    Their points are replaced by those of another person, since the optimisation needs finite start
    points that form a pose.

    Returns:
        Keypoints of N people, and (N,) bool, people with invalid ones.
    """
    valid = valid_keypoint_rows(keypoints)
    if keypoints.world is not None:
        valid &= (keypoints.confidence > 0).any(1)
    if valid.all():
        return keypoints, ~valid
    rows = np.where(valid, np.arange(len(valid)), valid.argmax())
    confidence = np.where(valid[:, None], keypoints.confidence, 0)
    return replace(select_people(keypoints, rows), confidence=confidence), ~valid


def discard_invalid_bodies(bodies: Bodies) -> tuple[Bodies, BoolArray]:
    """Set all values of invalid bodies to NaN; also return the mask (N,) bool of these bodies."""
    invalid = ~valid_body_rows(bodies)
    if not invalid.any():
        return bodies, invalid
    names = [field.name for field in fields(BodyParameters)]
    blank = replace(
        bodies,
        parameters=_with_neutral_rows(bodies.parameters, invalid, **dict.fromkeys(names, np.nan)),
    )
    mesh = (
        None if bodies.mesh is None else _with_neutral_rows(bodies.mesh, invalid, vertices=np.nan)
    )
    return _with_neutral_rows(replace(blank, mesh=mesh), invalid, joints=np.nan), invalid


def discard_invalid_hands(hands: Hands) -> tuple[Hands, BoolArray]:
    """Set the confidence of invalid hands to 0; also return the mask (N,) bool of people with such
    hands.
    """
    invalid = ~valid_hand_rows(hands)
    return _with_neutral_rows(hands, invalid, rotvecs=0.0, confidence=0.0, wrists=0.0), invalid


def expand_contact(
    contact: ContactProbability, has_contact: BoolArray
) -> tuple[ContactProbability, BoolArray]:
    """Expand contact of some people to all N people, with 0 for the others and for invalid rows.

    Args:
        contact: of the people selected by ``has_contact``.
        has_contact: (N,) bool.

    Returns:
        Contact of N people, and (N,) bool, people with invalid rows.
    """
    probability = contact.probability
    valid = valid_contact_rows(contact)
    invalid = np.zeros(len(has_contact), bool)
    invalid[has_contact] = ~valid
    expanded = np.zeros((len(has_contact), probability.shape[1]), probability.dtype)
    expanded[has_contact & ~invalid] = probability[valid]
    return replace(contact, probability=expanded), invalid


def implausible_contact(contact: ContactProbability, bodies: Bodies) -> str:
    """Return what makes contact probabilities of N bodies doubtful; "" if nothing does."""
    likely = contact.probability[valid_contact_rows(contact)]
    most = float((likely >= LEAST_PROBABILITY).mean(1).max(initial=0))
    if most > _MOST_CONTACT:
        return (
            f"its probabilities say that {most:.0%} of a body are in contact: is 1 contact, or are "
            f"they inverted?"
        )
    feet_seen = bodies.observed is None or bodies.observed[:, joint_pair("ankle")].any()
    if likely.size and feet_seen and not likely.any():
        return "its probabilities are 0 everywhere, even at feet that the photo shows"
    return ""


def _with_neutral_rows(result: Any, invalid: BoolArray, **blanks: float) -> Any:
    """Return a copy of a result with the rows of some people set to one number per field."""
    changed = {}
    for name, blank in blanks.items():
        value = getattr(result, name)
        if value is not None:
            changed[name] = value.copy()
            changed[name][invalid] = blank
    return replace(result, **changed)
