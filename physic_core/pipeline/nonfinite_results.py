"""Replace non-finite backend results of people, so that the pipeline continues with the other people.

Each function takes a checked result. It returns the result with the rows of non-finite people replaced by values for
"unknown", and a mask (N,) bool of these people. :func:`select_people` selects the rows of some people.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from physic_core.interfaces.body_estimator import finite_bodies
from physic_core.interfaces.contact_prior import finite_contact
from physic_core.interfaces.hand_estimator import finite_hands
from physic_core.interfaces.keypoint_detector import finite_keypoints
from physic_core.types import BodyParameters

if TYPE_CHECKING:
    from physic_core.types import Bodies, BoolArray, ContactProbability, Hands, Keypoints, People

__all__ = [
    "expand_contact",
    "invalidate_nonfinite_bodies",
    "invalidate_nonfinite_hands",
    "invalidate_nonfinite_keypoints",
    "select_people",
]

Result = TypeVar("Result", "People", "Keypoints", "Bodies")


_SHARED = ("floor", "labels", "faces", "rest", "unposed_mask")
"""Names of arrays without a row for each person."""


def invalidate_nonfinite_keypoints(keypoints: Keypoints) -> tuple[Keypoints, BoolArray]:
    """Set the confidence of people with non-finite keypoints to 0.

    Their points are replaced by those of another person, since the optimisation needs finite start points that form a
    pose.

    Returns:
        Keypoints of N people, and (N,) bool, people with non-finite ones.
    """
    finite = finite_keypoints(keypoints)
    if finite.all():
        return keypoints, ~finite
    one = int(finite.argmax())
    confidence = np.where(finite[:, None], keypoints.confidence, 0)
    points, world = keypoints.points.copy(), keypoints.world
    points[~finite] = points[one]
    if world is not None:
        world = world.copy()
        world[~finite] = world[one]
    return replace(keypoints, points=points, confidence=confidence, world=world), ~finite


def invalidate_nonfinite_bodies(bodies: Bodies) -> tuple[Bodies, BoolArray]:
    """Set all values of non-finite bodies to NaN; also return the mask (N,) bool of these bodies."""
    nonfinite = ~finite_bodies(bodies)
    if not nonfinite.any():
        return bodies, nonfinite
    names = [field.name for field in fields(BodyParameters)]
    blank = replace(bodies, parameters=_fill_rows(bodies.parameters, nonfinite, **dict.fromkeys(names, np.nan)))
    mesh = None if bodies.mesh is None else _fill_rows(bodies.mesh, nonfinite, vertices=np.nan)
    return _fill_rows(replace(blank, mesh=mesh), nonfinite, joints=np.nan), nonfinite


def invalidate_nonfinite_hands(hands: Hands) -> tuple[Hands, BoolArray]:
    """Set the confidence of non-finite hands to 0; also return the mask (N,) bool of people with such hands."""
    nonfinite = ~finite_hands(hands)
    return (
        _fill_rows(hands, nonfinite, rotvecs=0.0, confidence=0.0, wrists=0.0) if nonfinite.any() else hands
    ), nonfinite


def expand_contact(contact: ContactProbability, called: BoolArray) -> tuple[ContactProbability, BoolArray]:
    """Expand contact of some people to all N people, with 0 for the others and for non-finite rows.

    Args:
        contact: of the people selected by ``called``.
        called: (N,) bool.

    Returns:
        Contact of N people, and (N,) bool, people with non-finite rows.
    """
    probability = contact.probability
    finite = finite_contact(contact)
    nonfinite = np.zeros(len(called), bool)
    nonfinite[called] = ~finite
    expanded = np.zeros((len(called), probability.shape[1]), probability.dtype)
    expanded[called & ~nonfinite] = probability[finite]
    return replace(contact, probability=expanded), nonfinite


def select_people(result: Result, rows: BoolArray) -> Result:
    """Select the people of a result by ``rows``, (N,) bool; fields without rows per person are unchanged."""
    if rows.all():
        return result
    selected: Result = replace(result, **_select(result, rows))
    return selected


def _select(result: Any, rows: BoolArray) -> dict[str, Any]:
    changed: dict[str, Any] = {}
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, np.ndarray) and field.name not in _SHARED:
            changed[field.name] = value[rows]
        elif is_dataclass(value) and not isinstance(value, type):
            changed[field.name] = replace(value, **_select(value, rows))
    return changed


def _fill_rows(result: Any, nonfinite: BoolArray, **blanks: float) -> Any:
    """Return a copy of a result with the rows of some people set to one number per field."""
    changed = {}
    for name, blank in blanks.items():
        value = getattr(result, name)
        if value is not None:
            changed[name] = value.copy()
            changed[name][nonfinite] = blank
    return replace(result, **changed)
