"""Keypoints of every joint set that detectors answer, through the whole pipeline."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import SKELETONS, skeleton_named
from physic_testing.metrics import pa_mpjpe_mm
from tests.pipeline.mocks import run


@pytest.mark.parametrize("skeleton", ["coco17", "halpe26", "coco_wholebody133"])
def test_a_mock_world_is_reconstructed_from_each_skeleton(skeleton, world):
    # A sure metric depth: otherwise the distance is mostly its scale's.
    sure = "metric_depth.options.noise=0"
    given = f"keypoint_detector.options.skeleton={skeleton}"
    quick = "engine.joint.optimiser.steps=20"
    found = run(world.image, given, sure, quick)
    person = found.people[0]
    apart = 1000 * np.linalg.norm(person.vertices - world.vertices[0], axis=1).mean()
    aligned = pa_mpjpe_mm(person.joints[None, :22].astype(float), world.joints[:1, :22])
    assert skeleton_named(found.skeleton).name == skeleton
    assert person.keypoints.shape == (len(SKELETONS[skeleton].names), 2)
    assert aligned[0] < 40
    assert apart < 150
