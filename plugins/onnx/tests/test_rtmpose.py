"""RTMPose and RTMW3D: the grid of SimCC, colours, scores and depths."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector
from physic_core.types import SKELETONS
from physic_onnx.rtmpose import RtmPose, Rtmw3d
from physic_testing import violations

from .pose_worlds import BOX, PLACES, blobs, people, region


@pytest.fixture
def rtmpose(bound, stand_in_network):
    """A network whose joint j is where the colour j mod 3 of what it is shown is strongest."""

    def make(size=(256, 192), scale=1.0, split=2, batch="batch", shares_ranges=False, **options):
        def answer(feed):
            seen = feed["input"]
            if shares_ranges:
                step = np.ptp(seen) / 255
                seen = np.round(seen / step) * step
            lines = {"simcc_x": seen.max(2), "simcc_y": seen.max(3)}
            colours = np.arange(17) % 3
            return {out: scale * line[:, colours].repeat(split, 2) for out, line in lines.items()}

        inputs = {"input": ("float32", (batch, 3, *size))}
        outputs = {
            f"simcc_{axis}": ("float32", (batch, 17, split * side))
            for axis, side in zip("yx", size, strict=True)
        }
        network = stand_in_network(inputs, answer, outputs, shares_ranges=shares_ranges)
        return bound(RtmPose, network, **options)

    return make


@pytest.mark.parametrize(("size", "split"), [((256, 192), 2), ((384, 288), 3)])
def test_each_joint_is_found_at_the_blob_of_its_colour(rtmpose, size, split):
    found = rtmpose(size=size, split=split).infer(blobs(PLACES), people(BOX))
    assert violations(KeypointDetector, found, people=1) == []
    assert found.skeleton == "coco17"
    # half a pixel of the input is 0.44 px
    assert np.abs(found.points[0, :3] - PLACES).max() < 0.42


@pytest.fixture
def answering(bound, stand_in_network):
    """A network that answers these lines along x, y and z, whatever it is shown."""

    def make(*lines):
        size = (256, 192) if len(lines) == 2 else (384, 288)
        network = stand_in_network(
            {"input": ("float32", (len(lines[0]), 3, *size))},
            dict(zip(("simcc_x", "simcc_y", "simcc_z"), lines, strict=False)),
        )
        return bound(RtmPose if len(lines) == 2 else Rtmw3d, network)

    return make


def test_the_network_gets_rgb_unless_bgr_is_chosen(rtmpose):
    rgb = rtmpose().infer(blobs(PLACES), people(BOX)).points[0]
    bgr = rtmpose(channels="bgr").infer(blobs(PLACES), people(BOX)).points[0]
    assert np.abs(rgb[:3] - PLACES).max() < 2.5
    assert np.abs(bgr[:3] - PLACES[::-1]).max() < 2.5


def test_scores_above_one_are_cut_or_divided(rtmpose):
    grey = np.full((200, 260, 3), 255, np.uint8)
    top = (1 - np.array([0.485, 0.456, 0.406])) / [0.229, 0.224, 0.225]
    assert (rtmpose().infer(grey, people(BOX)).confidence == 1).all()
    assert np.allclose(
        rtmpose(full_score=10.0).infer(grey, people(BOX)).confidence[0, :3], top / 10, atol=1e-5
    )
    assert (rtmpose(scale=-1.0).infer(grey // 255 * 128 + 64, people(BOX)).confidence >= 0).all()


def test_lines_that_do_not_fit_the_input_are_refused(answering):
    backend = answering(np.zeros((1, 17, 384), np.float32), np.zeros((1, 17, 500), np.float32))
    with pytest.raises(BackendError, match="as many bins a pixel along both"):
        backend.infer(blobs(PLACES), people(BOX))


def test_depths_are_decoded_as_mmposes_rtmpose3d_does(answering):
    """A slow twin of the codec in its configurations: 288 x 384 px, two bins a pixel, depths of
    +-2.1744869 m.
    """
    rng = np.random.default_rng(2)
    lines = [
        rng.normal(0.3, 0.2, (2, 133, length)).astype(np.float32) for length in (576, 768, 576)
    ]
    boxes = [BOX, (10.0, 10.0, 200.0, 60.0)]
    found = answering(*lines).infer(blobs(PLACES), people(*boxes))
    bins = np.stack([line.argmax(-1) for line in lines], -1)
    peaks = [line.max(-1) for line in lines]
    for row, box in enumerate(boxes):
        centre, scale = region(np.array(box), 288, 384)
        places = bins[row, :, :2] / 2 / [288, 384] * scale + centre - scale / 2
        np.testing.assert_allclose(found.points[row], places, atol=1e-4)
    depths = (bins[..., 2] / 2 / (288 / 2) - 1) * 2.1744869
    np.testing.assert_allclose(found.world[..., 2], depths, atol=1e-4)
    np.testing.assert_allclose(found.confidence, np.minimum(1, np.minimum(*peaks[:2])), atol=1e-4)
    assert violations(KeypointDetector, found, people=2) == []


def test_a_person_is_as_large_as_the_limbs_say_with_their_depths(answering):
    """A limb of an adult that points away from the camera looks short, and does not make the person
    small.
    """
    rng = np.random.default_rng(0)
    names = SKELETONS["coco_wholebody133"].names
    metres = np.zeros((133, 3))
    for side, x in (("left", 0.2), ("right", -0.2)):
        leg = np.array([x / 2, 0, 0]), {"hip": 0, "knee": 0.38, "ankle": 0.43}
        arm = np.array([x, -0.5, 0]), {"shoulder": 0, "elbow": 0.26, "wrist": 0.23}
        for place, lengths in (leg, arm):
            for name, length in lengths.items():
                way = rng.normal(size=3)
                place += length * way / np.linalg.norm(way)
                metres[names.index(f"{side}_{name}")] = place
    # 200 bins a metre
    at = np.round(metres * [200, 200, 288 / 2.1744869] + [288, 300, 288]).astype(int)
    lines = [np.zeros((1, 133, length), np.float32) for length in (576, 768, 576)]
    for axis, line in enumerate(lines):
        line[0, np.arange(133), at[:, axis]] = 0.9
    world = answering(*lines).infer(blobs(PLACES), people(BOX)).world[0]
    own = metres.any(axis=1)
    np.testing.assert_allclose(world[own], metres[own], atol=0.01)


@pytest.mark.parametrize("batch", ["batch", 1, 4])
def test_people_of_a_network_with_dynamic_ranges_do_not_change_each_other(rtmpose, batch):
    """It has one range for all rows: a bright person would make steps of a dark one coarse."""
    detector = rtmpose(batch=batch, shares_ranges=True)
    photo = np.random.default_rng(0).integers(130, 170, (240, 640, 3), np.uint8)
    photo[:, 320:] += 85
    boxes = [(10.0, 20.0, 110.0, 220.0), (530.0, 20.0, 630.0, 220.0)]
    both = detector.infer(photo, people(*boxes, size=photo.shape[:2]))
    for i, box in enumerate(boxes):
        alone = detector.infer(photo, people(box, size=photo.shape[:2]))
        np.testing.assert_array_equal(both.points[i], alone.points[0])
        np.testing.assert_array_equal(both.confidence[i], alone.confidence[0])
