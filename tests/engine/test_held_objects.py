"""Objects in hands and on laps: which are held, and their shape."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.engine.contact.distances import object_distances
from physic_core.pipeline.backend_results import select_held_objects
from physic_core.types import Keypoints, People

K = torch.tensor([[200.0, 0.0, 60.0], [0.0, 200.0, 50.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
RADIUS = 0.15
AWAY = 2.0


def ball():
    """Mask (1, H, W) and depth (H, W) of a ball on the optical axis, in front of a wall."""
    row, column = torch.meshgrid(torch.arange(100.0), torch.arange(120.0), indexing="ij")
    x = ((column - 60) / 200).double()
    y = ((row - 50) / 200).double()
    along = 1 + x.square() + y.square()
    root = AWAY**2 - along * (AWAY**2 - RADIUS**2)
    depth = torch.where(root > 0, (AWAY - root.clamp(min=0).sqrt()) / along, 4.0)
    return (root > 0)[None], depth


def distances(points, ratio=1.0):
    mask, depth = ball()
    vertices = torch.tensor([points], dtype=torch.float64)
    ratios = torch.tensor([ratio], dtype=torch.float64)
    distance, _ = object_distances(vertices, mask, depth, ratios, K)
    return distance[0].tolist()


def test_the_hidden_side_of_an_object_is_as_far_behind_as_the_object_is_wide():
    front, side, back, inside, far = distances(
        [
            [0, 0, AWAY - 0.2],
            [0.2, 0, AWAY],
            [0, 0, AWAY + 0.2],
            [0, 0, AWAY + 0.1],
            [0, 0, AWAY - 0.4],
        ]
    )
    assert [front, side, back] == pytest.approx([0.05] * 3, abs=0.015)
    assert inside == pytest.approx(-0.05, abs=0.015)
    assert far == np.inf


def test_an_object_is_moved_with_the_person_who_holds_it():
    (moved,) = distances([[0, 0, 1.1 * (AWAY - 0.2)]], ratio=1.1)
    assert moved == pytest.approx(0.055, abs=0.002)
    assert distances([[0, 0, AWAY - 0.2]], ratio=np.nan) == [np.inf]


def test_a_vertex_in_the_first_column_of_the_picture_can_be_inside_an_object():
    mask, depth = ball()
    camera = K.clone()
    camera[0, 2] = 0.0
    one = torch.ones(1, dtype=torch.float64)
    vertices = torch.tensor([[[0, 0, AWAY - 0.12]]], dtype=torch.float64)
    distance, _ = object_distances(vertices, mask[..., 60:], depth[:, 60:], one, camera)
    assert float(distance) < 0


def people(*objects):
    """A person 40 px wide with a wrist at (60, 50), and objects of 6 px at (x, y)."""
    masks = np.zeros((1, 100, 120), bool)
    masks[0, 10:90, 40:60] = True
    patches = np.zeros((len(objects), 100, 120), bool)
    for patch, (x, y) in zip(patches, objects, strict=True):
        patch[y : y + 6, x : x + 6] = True
    points = np.zeros((1, 17, 2), np.float32)
    confidence = np.zeros((1, 17), np.float32)
    points[0, 9] = (60, 50)
    points[0, 7] = (50, 40)
    confidence[0, [7, 9]] = 0.9
    boxes = np.array([[40, 10, 60, 90]], np.float32)
    found = People(masks, boxes, np.ones(1, np.float32), objects=patches)
    return found, Keypoints(points, confidence, "coco17")


def test_objects_near_a_hand_are_held_without_the_pixels_of_people():
    found, keypoints = people((57, 52), (100, 10))
    held = select_held_objects(found, keypoints)
    assert held.shape == (1, 100, 120)
    assert held[0].sum() == 6 * 3
    assert not (held[0] & found.masks[0]).any()


def test_a_segmenter_that_looks_for_no_objects_leaves_them_unknown():
    found, keypoints = people()
    held = select_held_objects(found, keypoints)
    assert held.shape == (0, 100, 120)
    assert select_held_objects(People(found.masks, found.boxes, found.scores), keypoints) is None
