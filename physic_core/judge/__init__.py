"""Self-checks of a reconstruction: measured value, threshold, state, and advice for a failed check.

If nothing was measured, the value is None, the state "unknown", and the message says why. Names,
units and directions are stable. Each check is one function in ``photo``, ``people`` or ``limbs``,
with its spec above it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.judge import people, photo  # noqa: F401  # fill CHECKS
from physic_core.judge.limbs import limb_keypoint_error
from physic_core.judge.spec import (
    CHECKS,
    CheckSpec,
    failed_checks,
    unknown_checks,
    warning_messages,
)
from physic_core.judge.trust import capped_by_contradictions, no_trust, person_trust

if TYPE_CHECKING:
    from physic_core.engine.state import Estimates
    from physic_core.types import CheckResult, Reconstruction

__all__ = [
    "CHECKS",
    "CheckSpec",
    "capped_by_contradictions",
    "failed_checks",
    "limb_keypoint_error",
    "no_trust",
    "person_trust",
    "run_checks",
    "unknown_checks",
    "warning_messages",
]

_OF_PERSON = (
    *("given_size", "given_keypoints", "contradicted_keypoints", "stature", "child_size"),
    *("heads", "detected", "placed", "limb_keypoints", "body_in_mask", "support", "low_depth"),
    *("lean", "limb_sigma", "limb_spread", "contact_sure", "unknown_contacts", "hidden_limbs"),
)
"""Checks of a person, first those after which a user can state or correct something."""

for _name in _OF_PERSON:
    CHECKS[_name] = CHECKS.pop(_name)


def run_checks(estimates: Estimates, result: Reconstruction) -> tuple[CheckResult, ...]:
    """Run all self-checks, first of the photo, then of each person, in the order of ``CHECKS``.

    Optional ones for which nothing was measured are left out.
    """
    results = [
        spec.compare(spec.measure(estimates, result))
        for spec in CHECKS.values()
        if spec.of == "photo"
    ]
    for person in range(len(result.people)):
        results += [
            spec.compare(spec.measure(estimates, result, person), person)
            for spec in CHECKS.values()
            if spec.of == "person"
        ]
    return tuple(
        check for check in results if check.value is not None or not CHECKS[check.name].optional
    )
