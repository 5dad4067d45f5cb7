"""Checks of truth and predictions after they were read: shapes, finite values, and lengths that are metres."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_bench.contract import TOPOLOGY_OF_COUNT
from physic_bench.damage import DamagedFrameError, damaged_file_error

if TYPE_CHECKING:
    from physic_bench.contract import Frame, PredictedPerson, Prediction, TruePerson, Truth

MAX_DISTANCE_M = 200.0
"""No person is annotated farther from the camera. Millimetres and world coordinates of a map are."""

_COUNT = {name: count for count, name in TOPOLOGY_OF_COUNT.items()}


def checked_truth(frame: Frame) -> Truth:
    """Return the truth of a frame.

    Raises:
        DamagedFrameError: a file is damaged, or a body is not finite, or not in metres.
    """
    try:
        truth = frame.truth()
    except PermissionError as error:
        raise damaged_file_error(Path(error.filename or frame.id), error) from error
    for person in truth.people:
        who = f"the annotated person {person.name}" if person.name else "the annotated person"
        _check_person(person, who)
        points = person.vertices if person.vertices is not None else person.joints
        if points is None or not np.isfinite(points).any():
            continue
        distance = float(np.nanmedian(np.linalg.norm(points, axis=-1)))
        if distance > MAX_DISTANCE_M:
            raise DamagedFrameError(f"{who} is {distance:.0f} m from the camera: lengths must be metres")
    return truth


def check_prediction(found: Prediction) -> None:
    """Refuse what would make figures NaN; joints may be NaN where a method has none.

    Raises:
        DamagedFrameError: an array is not finite, or of another shape.
    """
    if found.K is not None and not np.isfinite(found.K).all():
        raise DamagedFrameError("the camera K has values that are not finite")
    for row, person in enumerate(found.people):
        _check_person(person, f"person {row}")
        if person.joints is not None and not np.isfinite(person.joints).any():
            raise DamagedFrameError(f"no joint of person {row} is finite")


def _check_person(person: PredictedPerson | TruePerson, who: str) -> None:
    for what, points in (("vertices", person.vertices), ("joints", person.joints)):
        if points is not None and (points.ndim != 2 or points.shape[1] != 3):
            raise DamagedFrameError(f"the {what} of {who} must have the shape (n, 3), got {points.shape}")
    if person.joints is not None and len(person.joints) != len(person.joint_names):
        raise DamagedFrameError(f"{who} has {len(person.joints)} joints, but {len(person.joint_names)} names of joints")
    if person.vertices is not None and not np.isfinite(person.vertices).all():
        bad = int((~np.isfinite(person.vertices).all(1)).sum())
        raise DamagedFrameError(f"{bad} of the {len(person.vertices)} vertices of {who} are not finite")
    mesh = person.contact_topology or person.topology
    if person.contact is not None and len(person.contact) != _COUNT.get(mesh, len(person.contact)):
        raise DamagedFrameError(
            f"the contact of {who} has {len(person.contact)} vertices, where {mesh} has {_COUNT[mesh]}"
        )
