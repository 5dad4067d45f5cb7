"""Handle backend results that are non-finite for some people: mark those people and keep the others.

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
    "drop_nonfinite_bodies",
    "drop_nonfinite_hands",
    "drop_nonfinite_keypoints",
    "expand_contact",
    "select_people",
]

Result = TypeVar("Result", "People", "Keypoints", "Bodies")


_SHARED = ("floor", "faces", "rest")
"""Arrays without a row for each person."""


def drop_nonfinite_keypoints(keypoints: Keypoints) -> tuple[Keypoints, BoolArray]:
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


def drop_nonfinite_bodies(bodies: Bodies) -> tuple[Bodies, BoolArray]:
    """Set all values of people with a non-finite body to NaN; also returns (N,) bool, these people."""
    lost = ~finite_bodies(bodies)
    if not lost.any():
        return bodies, lost
    names = [field.name for field in fields(BodyParameters)]
    blank = replace(bodies, parameters=_fill_rows(bodies.parameters, lost, **dict.fromkeys(names, np.nan)))
    mesh = None if bodies.mesh is None else _fill_rows(bodies.mesh, lost, vertices=np.nan)
    return _fill_rows(replace(blank, mesh=mesh), lost, joints=np.nan), lost


def drop_nonfinite_hands(hands: Hands) -> tuple[Hands, BoolArray]:
    """Mark non-finite hands as not found; also returns (N,) bool, people with such hands."""
    lost = ~finite_hands(hands)
    return (_fill_rows(hands, lost, rotvecs=0.0, confidence=0.0, wrists=0.0) if lost.any() else hands), lost


def expand_contact(contact: ContactProbability, called: BoolArray) -> tuple[ContactProbability, BoolArray]:
    """Contact of the people of a call -> contact of all N people, 0 for the others and for non-finite rows.

    Args:
        contact: of the people selected by ``called``.
        called: (N,) bool.

    Returns:
        Contact of N people, and (N,) bool, people with non-finite rows.
    """
    probability = contact.probability
    finite = finite_contact(contact)
    lost = np.zeros(len(called), bool)
    lost[called] = ~finite
    whole = np.zeros((len(called), probability.shape[1]), probability.dtype)
    whole[called & ~lost] = probability[finite]
    return replace(contact, probability=whole), lost


def select_people(result: Result, rows: BoolArray) -> Result:
    """A result for N people -> for those of ``rows``, (N,) bool; fields without rows per person are kept."""
    if rows.all():
        return result
    kept: Result = replace(result, **_select(result, rows))
    return kept


def _select(result: Any, rows: BoolArray) -> dict[str, Any]:
    changed: dict[str, Any] = {}
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, np.ndarray) and field.name not in _SHARED:
            changed[field.name] = value[rows]
        elif is_dataclass(value) and not isinstance(value, type):
            changed[field.name] = replace(value, **_select(value, rows))
    return changed


def _fill_rows(result: Any, lost: BoolArray, **blanks: float) -> Any:
    """A copy with the rows of some people set to one number per field."""
    changed = {}
    for name, blank in blanks.items():
        value = getattr(result, name)
        if value is not None:
            changed[name] = value.copy()
            changed[name][lost] = blank
    return replace(result, **changed)
