"""All interfaces answered from a synthetic world with ground truth: for tests, and to learn what passes where."""

from __future__ import annotations

from physic_core import BackendRecord, hookimpl

__all__ = ["NOISE_VERSION", "physic_backends"]

NOISE_VERSION = "3"
"""Names the error models and their defaults; figures measured under different versions do not compare."""

_CLASSES = {
    "segmenter": "MockSegmenter",
    "inpainter": "MockInpainter",
    "metric_depth": "MockMetricDepth",
    "relative_pointmap": "MockRelativePointmap",
    "keypoint_detector": "MockKeypointDetector",
    "body_estimator": "MockBodyEstimator",
    "hand_estimator": "MockHandEstimator",
    "contact_prior": "MockContactPrior",
}


@hookimpl
def physic_backends() -> list[BackendRecord]:
    """The backends of this plugin."""
    return [
        BackendRecord(
            interface, "mock", f"physic_mock.backends:{name}", api=1, summary="The truth of a small synthetic world"
        )
        for interface, name in _CLASSES.items()
    ]
