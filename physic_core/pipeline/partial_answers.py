"""Keeps the people whom a backend understood, where it answered NaN for others of the same photo.

Each function takes a validated result (:mod:`physic_core.pipeline.validation`) and returns it with the rows of the
people that are lost set to what stands for "nothing is known". :func:`rows_of` picks the rows of some people, for a
backend that may not see the others.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from physic_core.pipeline import validation as border
from physic_core.types import BodyParameters

if TYPE_CHECKING:
    from physic_core.types import Bodies, BoolArray, ContactProbability, Hands, Keypoints, People

__all__ = [
    "bodies_or_nan",
    "contact_of_all",
    "found_hands",
    "rows_of",
    "seen_keypoints",
]

Answer = TypeVar("Answer", "People", "Keypoints", "Bodies")


_SHARED = ("floor", "faces", "rest")
"""Arrays without a row for each person."""


def seen_keypoints(keypoints: Keypoints) -> tuple[Keypoints, BoolArray]:
    """Keypoints of N people, those of lost people all unseen, and (N,) bool who is lost.

    Where an unseen point lies means nothing, but all at one spot, or none of a number, would be no pose to start from:
    lost people get the points of one who is not.
    """
    sound = border.sound_keypoints(keypoints)
    if sound.all():
        return keypoints, ~sound
    one = int(sound.argmax())
    confidence = np.where(sound[:, None], keypoints.confidence, 0)
    points, world = keypoints.points.copy(), keypoints.world
    points[~sound] = points[one]
    if world is not None:
        world = world.copy()
        world[~sound] = world[one]
    return replace(keypoints, points=points, confidence=confidence, world=world), ~sound


def bodies_or_nan(bodies: Bodies) -> tuple[Bodies, BoolArray]:
    """Bodies of N people, those of lost people NaN throughout, and (N,) bool who is lost."""
    lost = ~border.sound_bodies(bodies)
    if not lost.any():
        return bodies, lost
    names = [field.name for field in fields(BodyParameters)]
    blank = replace(bodies, parameters=_blanked(bodies.parameters, lost, **dict.fromkeys(names, np.nan)))
    mesh = None if bodies.mesh is None else _blanked(bodies.mesh, lost, vertices=np.nan)
    return _blanked(replace(blank, mesh=mesh), lost, joints=np.nan), lost


def found_hands(hands: Hands) -> tuple[Hands, BoolArray]:
    """Hands of N people, those of lost people not found, and (N,) bool who is lost."""
    lost = ~border.sound_hands(hands)
    return (_blanked(hands, lost, rotvecs=0.0, confidence=0.0, wrists=0.0) if lost.any() else hands), lost


def contact_of_all(contact: ContactProbability, asked: BoolArray) -> tuple[ContactProbability, BoolArray]:
    """Contact of the people who were ``asked`` about, (N,) bool, with those of all N: 0 for the rest and the lost."""
    probability = contact.probability
    sound = border.sound_contact(contact)
    lost = np.zeros(len(asked), bool)
    lost[asked] = ~sound
    whole = np.zeros((len(asked), probability.shape[1]), probability.dtype)
    whole[asked & ~lost] = probability[sound]
    return replace(contact, probability=whole), lost


def rows_of(answer: Answer, rows: BoolArray) -> Answer:
    """An answer about N people -> about those of ``rows``, (N,) bool; what all people share is kept."""
    if rows.all():
        return answer
    kept: Answer = replace(answer, **_picked(answer, rows))
    return kept


def _picked(answer: Any, rows: BoolArray) -> dict[str, Any]:
    changed: dict[str, Any] = {}
    for field in fields(answer):
        value = getattr(answer, field.name)
        if isinstance(value, np.ndarray) and field.name not in _SHARED:
            changed[field.name] = value[rows]
        elif is_dataclass(value) and not isinstance(value, type):
            changed[field.name] = replace(value, **_picked(value, rows))
    return changed


def _blanked(answer: Any, lost: BoolArray, **blanks: float) -> Any:
    """A copy with the rows of lost people set to one number a field."""
    changed = {}
    for name, blank in blanks.items():
        value = getattr(answer, name)
        if value is not None:
            changed[name] = value.copy()
            changed[name][lost] = blank
    return replace(answer, **changed)
