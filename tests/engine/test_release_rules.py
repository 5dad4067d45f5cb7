"""Rules of the released code, one by one, on small examples with a known answer."""

from __future__ import annotations

import math

import pytest
import torch
from torch.testing import assert_close

from physic_core.types import SKELETONS, skeleton_named
from physic_paper.released.pointmap import published_floor_grid, published_normals
from physic_paper.released.reprojection import released_keypoint_weights


def weights(skeleton, confidence, points=None):
    """Of one person whose mask is a square in the middle, all keypoints inside."""
    mask = torch.zeros(1, 100, 200, dtype=torch.bool)
    mask[0, 40:60, 90:110] = True
    inside = torch.full((1, len(confidence), 2), 50.0) + torch.tensor([50.0, 0.0])
    return released_keypoint_weights(
        skeleton_named(skeleton),
        inside if points is None else points,
        torch.tensor([confidence]),
        mask,
    )[0].tolist()


def test_body_and_feet_count_ten_times_their_confidence_and_unsure_keypoints_nothing():
    names = SKELETONS["coco_wholebody133"].names
    confidence = [0.9] * len(names)
    confidence[3] = 0.49
    confidence[40] = 0.5
    got = weights("coco_wholebody133", confidence)
    assert got[:23] == pytest.approx([9.0] * 3 + [0.0] + [9.0] * 19)
    assert got[40] == pytest.approx(0.5)
    assert got[91:] == pytest.approx([0.9] * 42)
    face = [
        j
        for j, name in enumerate(SKELETONS["wholebody69"].names)
        if "inner" in name or "outer" in name or "mouth" in name
    ]
    assert [weights("wholebody69", [0.9] * 69)[j] for j in face] == pytest.approx([0.9] * 6)


def test_floor_samples_span_the_scene_in_x_and_z():
    normal = torch.tensor([0.0, -0.8, -0.6])
    x = torch.arange(100.0)
    points = torch.stack([x, torch.zeros(100), 2 * x], -1)
    floor = published_floor_grid(normal, 1.5, points, 3)
    assert floor[:, 0].tolist() == pytest.approx([2.0] * 3 + [50.0] * 3 + [98.0] * 3)
    assert floor[:3, 2].tolist() == pytest.approx([4.0, 100.0, 196.0])
    assert (floor @ normal + 1.5).abs().max() < 1e-4
    assert not len(published_floor_grid(torch.tensor([1.0, 0.0, 0.0]), 1.5, points, 3))
    assert not len(published_floor_grid(normal, 1.5, points[:0], 3))


def test_normals_are_those_of_four_crosses_and_look_at_the_camera():
    """A plane that falls off to the right by 45 degrees, and one pixel of it that is not valid."""
    v, u = torch.meshgrid(torch.arange(7.0), torch.arange(9.0), indexing="ij")
    points = torch.stack([u, v, 20 + u], -1)
    valid = torch.ones(7, 9, dtype=torch.bool)
    normals = published_normals(points, valid)
    slope = torch.tensor([1.0, 0.0, -1.0]) / math.sqrt(2)
    assert_close(normals, slope.expand(7, 9, 3))
    valid[3, 4] = False
    assert published_normals(points, valid)[3, 4].eq(0).all()
    # too near for its threshold
    assert published_normals(1e-4 * points, torch.ones_like(valid)).eq(0).all()
