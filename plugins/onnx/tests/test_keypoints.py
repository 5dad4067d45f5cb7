"""ViTPose, RTMW and RTMW3D: grids, colours, scores and depths."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.interfaces import KeypointDetector
from physic_onnx.rtmpose import RtmPose, Rtmw3d
from physic_onnx.vitpose import VitPose
from physic_testing import violations

from .pose_worlds import BOX, PLACES, blobs, people

COLOURS = np.arange(133) % 3


def heatmaps(feed):
    """Joint j is the colour j mod 3; cell q is pixel 4 q, as in MMPose's affine."""
    return {"heatmaps": feed["picture"][:, COLOURS, ::4, ::4]}


def lines(feed):
    """Joint j is where the colour j mod 3 is strongest, two bins a pixel."""
    channels = feed["picture"][:, COLOURS]
    return {"x": channels.max(2).repeat(2, -1), "y": channels.max(3).repeat(2, -1)}


@pytest.mark.parametrize("batch", ["batch", 1, 3])
@pytest.mark.parametrize(
    ("kind", "answer", "off_px"), [(VitPose, heatmaps, 1.0), (RtmPose, lines, 0.45)]
)
def test_joints_are_found_at_the_blob_of_their_colour(
    bound, stand_in_network, kind, answer, off_px, batch
):
    backend = bound(kind, stand_in_network({"picture": (batch, 3, *kind.crop_size)}, answer))
    boxes = [BOX, (40.0, 10.0, 180.0, 190.0)]
    keypoints = backend.infer(blobs(PLACES), people(*boxes))
    assert violations(KeypointDetector, keypoints, people=2) == []
    assert np.linalg.norm(keypoints.points[:, :3] - PLACES, axis=-1).max() < off_px
    assert backend.infer(blobs(PLACES), people()).points.shape == (0, 133, 2)


@pytest.fixture
def rtmw3d(bound, stand_in_network):
    """A network that answers these lines along x, y and z, whatever it is shown."""

    def make(*lines):
        answer = dict(zip(("output", "1554", "1556"), lines, strict=True))
        return bound(Rtmw3d, stand_in_network({"input": (len(lines[0]), 3, 384, 288)}, answer))

    return make


def test_depths_are_decoded_as_mmposes_rtmpose3d_does(rtmw3d):
    """A slow twin of the codec in its configurations: 288 x 384 px, two bins a pixel, depths of
    +-2.1744869 m, boxes widened by a quarter and to the aspect.
    """
    rng = np.random.default_rng(2)
    rows = [rng.normal(0.3, 0.4, (2, 133, length)).astype(np.float32) for length in (576, 768, 576)]
    boxes = [BOX, (10.0, 10.0, 200.0, 60.0)]
    keypoints = rtmw3d(*rows).infer(blobs(PLACES), people(*boxes))
    bins = np.stack([row.argmax(-1) for row in rows], -1)
    for person, box in enumerate(np.array(boxes)):
        size = box[2:] - box[:2]
        scale = 1.25 * np.maximum(size, size[::-1] * [288 / 384, 384 / 288])
        centre = (box[:2] + box[2:]) / 2 - 0.5
        places = bins[person, :, :2] / 2 / [288, 384] * scale + centre - scale / 2
        np.testing.assert_allclose(keypoints.points[person], places, atol=1e-4)
    depths = (bins[..., 2] / 2 / (288 / 2) - 1) * 2.1744869
    np.testing.assert_allclose(keypoints.world[..., 2], depths, atol=1e-4)
    peaks = np.minimum(rows[0].max(-1), rows[1].max(-1))
    assert (peaks > 1).any()
    np.testing.assert_allclose(keypoints.confidence, np.minimum(1, peaks), atol=1e-4)
    assert violations(KeypointDetector, keypoints, people=2) == []
