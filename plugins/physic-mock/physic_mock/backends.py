"""All eight mocks: each reads the truth of a world and adds a stated, seeded error."""

from __future__ import annotations

from physic_mock.depths import MockMetricDepth, MockRelativePointmap
from physic_mock.humans import MockBodyEstimator, MockContactPrior, MockHandEstimator
from physic_mock.pixels import MockInpainter, MockKeypointDetector, MockSegmenter

__all__ = [
    "MockBodyEstimator",
    "MockContactPrior",
    "MockHandEstimator",
    "MockInpainter",
    "MockKeypointDetector",
    "MockMetricDepth",
    "MockRelativePointmap",
    "MockSegmenter",
]
