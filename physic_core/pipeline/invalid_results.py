"""Replace invalid backend results of people, so that the pipeline continues with the other people.

Each function takes a checked result. It returns the result with the rows of people with invalid numbers replaced
by values for "unknown", and a mask (N,) bool of these people.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.interfaces.body_estimator import valid_body_rows
from physic_core.interfaces.contact_prior import valid_contact_rows
from physic_core.interfaces.hand_estimator import valid_hand_rows
from physic_core.interfaces.keypoint_detector import valid_keypoint_rows
from physic_core.types import BodyParameters

if TYPE_CHECKING:
    from physic_core.types import Bodies, BoolArray, ContactProbability, Hands, Keypoints


def discard_invalid_keypoints(keypoints: Keypoints) -> tuple[Keypoints, BoolArray]:
    """Set the confidence of people with invalid keypoints to 0.

    Their points are replaced by those of another person, since the optimisation needs finite start points that form a
    pose.

    Returns:
        Keypoints of N people, and (N,) bool, people with invalid ones.
    """
    valid = valid_keypoint_rows(keypoints)
    if valid.all():
        return keypoints, ~valid
    one = int(valid.argmax())
    confidence = np.where(valid[:, None], keypoints.confidence, 0)
    given = {name: getattr(keypoints, name) for name in ("points", "world", "sigma", "depth_sigma")}
    rows = np.where(valid, np.arange(len(valid)), one)
    others = {name: value[rows] for name, value in given.items() if value is not None}
    return replace(keypoints, confidence=confidence, **others), ~valid


def discard_invalid_bodies(bodies: Bodies) -> tuple[Bodies, BoolArray]:
    """Set all values of invalid bodies to NaN; also return the mask (N,) bool of these bodies."""
    invalid = ~valid_body_rows(bodies)
    if not invalid.any():
        return bodies, invalid
    names = [field.name for field in fields(BodyParameters)]
    blank = replace(bodies, parameters=_fill_rows(bodies.parameters, invalid, **dict.fromkeys(names, np.nan)))
    mesh = None if bodies.mesh is None else _fill_rows(bodies.mesh, invalid, vertices=np.nan)
    return _fill_rows(replace(blank, mesh=mesh), invalid, joints=np.nan), invalid


def discard_invalid_hands(hands: Hands) -> tuple[Hands, BoolArray]:
    """Set the confidence of invalid hands to 0; also return the mask (N,) bool of people with such hands."""
    invalid = ~valid_hand_rows(hands)
    return (_fill_rows(hands, invalid, rotvecs=0.0, confidence=0.0, wrists=0.0) if invalid.any() else hands), invalid


def expand_contact(contact: ContactProbability, called: BoolArray) -> tuple[ContactProbability, BoolArray]:
    """Expand contact of some people to all N people, with 0 for the others and for invalid rows.

    Args:
        contact: of the people selected by ``called``.
        called: (N,) bool.

    Returns:
        Contact of N people, and (N,) bool, people with invalid rows.
    """
    probability = contact.probability
    valid = valid_contact_rows(contact)
    invalid = np.zeros(len(called), bool)
    invalid[called] = ~valid
    expanded = np.zeros((len(called), probability.shape[1]), probability.dtype)
    expanded[called & ~invalid] = probability[valid]
    return replace(contact, probability=expanded), invalid


def _fill_rows(result: Any, invalid: BoolArray, **blanks: float) -> Any:
    """Return a copy of a result with the rows of some people set to one number per field."""
    changed = {}
    for name, blank in blanks.items():
        value = getattr(result, name)
        if value is not None:
            changed[name] = value.copy()
            changed[name][invalid] = blank
    return replace(result, **changed)
