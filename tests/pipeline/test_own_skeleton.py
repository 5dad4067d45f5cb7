"""A detector with points that the core has never heard of: from a plugin through the engine, the
kit and the files.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core import load_reconstruction
from physic_core.types import Keypoints, Skeleton
from physic_mock.keypoints import KeypointOptions, MockKeypointDetector
from physic_mock.recognition import match_masks_to_world, recognise_world
from physic_testing.conformance import check_backend
from physic_testing.conformance.true_keypoints import true_keypoints_px
from physic_testing.metrics import pa_mpjpe_mm
from tests.pipeline.mocks import run

SIDES = ("left", "right")
BLENDS = {
    **{f"{s}_mid_thigh": {f"{s}_hip": 0.5, f"{s}_knee": 0.5} for s in SIDES},
    **{f"{s}_mid_shin": {f"{s}_knee": 0.5, f"{s}_ankle": 0.5} for s in SIDES},
    **{f"{s}_deltoid": {f"{s}_shoulder": 0.8, f"{s}_elbow": 0.2} for s in SIDES},
    **{f"{s}_watch": {f"{s}_wrist": 0.9, f"{s}_elbow": 0.1} for s in SIDES},
    "sternum": {"left_shoulder": 0.35, "right_shoulder": 0.35, "left_hip": 0.15, "right_hip": 0.15},
    "left_ankle": {"left_knee": 0.1},
    "hat": {},
}
MARKERS = Skeleton(
    "markers16",
    (*BLENDS, "right_ankle", "nose", "left_heel", "right_heel", "head"),
    on_body=BLENDS,
    weights={"sternum": 0.5},
)


class MarkerDetector(MockKeypointDetector):
    """The world's true points in a skeleton of this plugin's own."""

    def infer(self, image, people):
        found = recognise_world(image)
        points, visible = true_keypoints_px(found.world, MARKERS)
        rows = match_masks_to_world(found, people)
        return Keypoints(points[rows], np.where(visible[rows], 0.95, 0.3), MARKERS)


def test_the_engine_fits_keypoints_of_a_custom_skeleton(world, tmp_path):
    sure = "metric_depth.options.noise=0"
    detector = f"keypoint_detector.backend={__name__}:MarkerDetector"
    found = run(world.image, detector, sure, "engine.joint.optimiser.steps=20")
    person = found.people[0]
    aligned = pa_mpjpe_mm(person.joints[None, :22].astype(float), world.joints[:1, :22])[0]
    assert found.skeleton == MARKERS
    assert person.keypoints.shape == (len(MARKERS), 2)
    assert aligned < 40

    found.save(tmp_path / "result", "numbers")
    again = load_reconstruction(tmp_path / "result")
    assert again.skeleton == MARKERS
    np.testing.assert_allclose(again.people[0].keypoints, person.keypoints, atol=1e-3)


@pytest.mark.slow
def test_the_kit_accepts_a_skeleton_of_ones_own():
    report = check_backend(MarkerDetector(KeypointOptions()), "keypoint_detector")
    assert report.ok, str(report)
