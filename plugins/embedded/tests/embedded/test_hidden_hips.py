"""Hips at the end of what is seen are doubted, and all below a squeezed trunk; others are not."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.types import Keypoints
from physic_embedded.networks.blazepose import BLAZEPOSE_SKELETON
from physic_embedded.segmentation.hidden_hips import lower_confidence_of_hidden_hips

HEIGHT = 400
WIDTH = 600


def person(head_y):
    """Return joints of a person whose shoulders, 80 px apart, lie 20 px below the top border."""
    points = np.full((1, 33, 2), (300.0, 300.0), np.float32)
    points[0, :11] = (300, head_y)
    points[0, 11:13] = (340, 20), (260, 20)
    points[0, 23:25] = (330, 180), (270, 180)
    return Keypoints(points, np.ones((1, 33), np.float32), BLAZEPOSE_SKELETON)


def mask(width_at_border, first_row=0):
    result = np.zeros((1, HEIGHT, WIDTH), bool)
    result[0, first_row:, 300 - width_at_border // 2 : 300 + width_at_border // 2] = True
    return result


@pytest.mark.parametrize(
    ("legs", "below_px", "doubted"),
    [(0.1, 40, True), (0.9, 40, False), (0.1, 100, False)],
    ids=["seen to the hips", "a leg is seen", "seen below the hips"],
)
def test_only_hips_at_the_end_of_what_is_seen_are_doubted(legs, below_px, doubted):
    seen = person(head_y=5)
    seen.confidence[0, 25:29] = legs
    masks = mask(120)
    masks[0, 180 + below_px :] = False
    hips = lower_confidence_of_hidden_hips(seen, masks).confidence[0, 23:25]
    assert (hips < 0.5).tolist() == [doubted, doubted]


@pytest.mark.parametrize(("face_px", "doubted"), [(22, False), (60, True)])
def test_legs_below_a_trunk_that_is_too_short_for_the_face_are_doubted(face_px, doubted):
    seen = person(head_y=90)
    seen.points[0, [2, 5], 1] = 90 - face_px
    confidence = lower_confidence_of_hidden_hips(seen, mask(120)).confidence[0]
    assert (confidence[23:] < 0.3).all() == doubted
    assert (confidence[:23] == 1).all()
