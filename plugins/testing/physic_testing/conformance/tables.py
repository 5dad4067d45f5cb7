"""What is checked of the outputs of each interface."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_testing.conformance import (
    body_estimator,
    contact_prior,
    depths,
    hand_estimator,
    inpainter,
    keypoint_detector,
    person_observer,
    segmenter,
)

if TYPE_CHECKING:
    from physic_testing.conformance.known_mistakes import Table

TABLES: dict[str, Table] = {
    "segmenter": segmenter.TABLE,
    "inpainter": inpainter.TABLE,
    "metric_depth": depths.METRIC_DEPTH,
    "relative_pointmap": depths.RELATIVE_POINTMAP,
    "keypoint_detector": keypoint_detector.TABLE,
    "body_estimator": body_estimator.TABLE,
    "hand_estimator": hand_estimator.TABLE,
    "person_observer": person_observer.TABLE,
    "contact_prior": contact_prior.TABLE,
}
"""Interface -> what is checked of its outputs; others have only the general checks."""
