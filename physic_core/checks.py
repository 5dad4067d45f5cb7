"""What a reconstruction says of its own trust: checks that a person did not pass, and warnings in plain words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from physic_core.perception import Evidence
    from physic_core.solution import Solution
    from physic_core.types import BoolArray

__all__ = ["CHECKS", "failed_checks", "warnings_of"]

_REPROJECTION_SHARE = 0.03
_PENETRATION_SHARE = 0.1
_FLOATING_M = 0.05
_SCALE_SIGMA = 0.15
_SCALE_CHANGE = 0.25

CHECKS: Mapping[str, str] = {
    "optimised": "the joint optimisation left this person at their start",
    "reprojection": "confident keypoints miss the body by more than 3 % of its height in the picture",
    "legs seen": "of one leg neither knee nor ankle is seen: that leg is a guess",
    "penetration": "more than 10 % of the visible surface lies over 3 cm inside the scene",
    "grounded": "the body hangs more than 5 cm away from everything that it could touch",
}
"""Check -> what it means when a person fails it."""

_KNEES, _ANKLES = [4, 5], [7, 8]  # left and right


def failed_checks(evidence: Evidence, solution: Solution, person: int) -> tuple[str, ...]:
    """Names of the checks that one person does not pass, in the order of ``CHECKS``."""
    told = solution.people[person]
    observed = evidence.bodies.observed
    legs_seen = observed is None or _both_legs(observed[person])
    failed = {
        "optimised": bool(solution.failures[person]),
        "reprojection": _number(told, "reprojection_share") > _REPROJECTION_SHARE,
        "legs seen": not legs_seen,
        "penetration": _number(told, "penetration_share") > _PENETRATION_SHARE,
        # Whose legs nobody sees may stand on them anywhere.
        "grounded": legs_seen and _number(told, "floating_m") > _FLOATING_M,
    }
    return tuple(name for name in CHECKS if failed[name])


def warnings_of(evidence: Evidence, solution: Solution) -> tuple[str, ...]:
    """What the user should know of the whole result."""
    notes = [f"person {i} stays where the placement left them: {why}" for i, why in enumerate(solution.failures) if why]
    sigma = evidence.depth.scale_sigma
    if sigma is not None and sigma > _SCALE_SIGMA:
        notes.append(f"all lengths may be off by {sigma:.0%} (one standard deviation): the photo gives no better scale")
    scale = solution.scene.scale
    if abs(scale - 1) > _SCALE_CHANGE:
        notes.append(f"the people and the metric depth disagree: the scene was rescaled by {scale:.2f}")
    return tuple(notes)


def _both_legs(observed: BoolArray) -> bool:
    return bool((observed[_KNEES] | observed[_ANKLES]).all())


def _number(told: Mapping[str, Any], name: str) -> float:
    value = told.get(name)
    return 0.0 if value is None else float(value)
