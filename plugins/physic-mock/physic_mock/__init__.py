"""Mock backends of all interfaces: ground truth of a synthetic world with random errors."""

from __future__ import annotations

from physic_core import BackendRecord, hookimpl

__all__ = ["NOISE_VERSION", "physic_backends"]

NOISE_VERSION = "4"
"""Version of the error models; do not compare results of different versions."""

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
    """Return the records of the mock backends, one per interface."""
    return [
        BackendRecord(
            interface, "mock", f"physic_mock.backends:{name}", api=1, summary="The truth of a small synthetic world"
        )
        for interface, name in _CLASSES.items()
    ]
