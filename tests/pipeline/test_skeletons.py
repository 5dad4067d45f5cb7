"""Keypoints of every joint set that detectors answer, through the whole pipeline."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core import load_config, reconstruct
from physic_core.body import load_body
from physic_core.engine.floor_and_scale import feet_pixels
from physic_core.metrics import pa_mpjpe_mm
from physic_core.types import SKELETONS, Keypoints, skeleton_named

from .consistency import consistency


@pytest.mark.parametrize("skeleton", ["coco17", "halpe26", "coco_wholebody133"])
def test_a_mock_world_is_reconstructed_from_each_skeleton(skeleton, world):
    # A sure metric depth: otherwise the distance is mostly its scale's.
    sure = "metric_depth.options.noise=0"
    config = load_config(
        preset="mock", overrides=[f"keypoint_detector.options.skeleton={skeleton}", sure]
    )
    found = reconstruct(world.image, config)
    person = found.people[0]
    apart = 1000 * np.linalg.norm(person.vertices - world.vertices[0], axis=1).mean()
    aligned = pa_mpjpe_mm(person.joints[None, :22].astype(float), world.joints[:1, :22])
    measured = consistency(found, load_body("embedded"))
    assert measured[0].keypoint_error_share < 0.05
    assert skeleton_named(found.skeleton).name == skeleton
    assert person.keypoints.shape == (len(SKELETONS[skeleton].names), 2)
    assert aligned[0] < 40
    assert apart < 150


@pytest.mark.parametrize(
    ("skeleton", "soles"), [("coco_wholebody133", 6), ("halpe26", 6), ("coco17", 0)]
)
def test_pixels_of_feet_are_found_in_every_skeleton(skeleton, soles):
    count = len(SKELETONS[skeleton].names)
    seen = Keypoints(np.full((1, count, 2), 10.0), np.ones((1, count)), skeleton)
    assert len(feet_pixels(seen, 100, 100)) == soles
