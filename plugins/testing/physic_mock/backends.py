"""All nine mock backends: each returns the ground truth of a world with seeded errors."""

from __future__ import annotations

from physic_mock.bodies_and_hands import MockBodyEstimator, MockHandEstimator
from physic_mock.contact import MockContactPrior
from physic_mock.depths import MockMetricDepth, MockRelativePointmap
from physic_mock.keypoints import MockKeypointDetector
from physic_mock.observer import MockPersonObserver
from physic_mock.segmenter_and_inpainter import MockInpainter, MockSegmenter

__all__ = [
    "MockBodyEstimator",
    "MockContactPrior",
    "MockHandEstimator",
    "MockInpainter",
    "MockKeypointDetector",
    "MockMetricDepth",
    "MockPersonObserver",
    "MockRelativePointmap",
    "MockSegmenter",
]
