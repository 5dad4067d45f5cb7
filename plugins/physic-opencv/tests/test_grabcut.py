from __future__ import annotations

import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_opencv.grabcut import GrabCut, GrabCutOptions

HEIGHT, WIDTH = 180, 240


def ellipse(centre: tuple[float, float], axes: tuple[float, float]) -> np.ndarray:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    return ((u - centre[0]) / axes[0]) ** 2 + ((v - centre[1]) / axes[1]) ** 2 <= 1


def scene(*people: np.ndarray) -> np.ndarray:
    """Reddish ellipses on a blue-green ground, both with noise."""
    image = np.random.default_rng(0).normal((60, 120, 140), 12, (HEIGHT, WIDTH, 3))
    for person in people:
        image[person] += [120, -40, -70]
    return np.clip(image, 0, 255).astype(np.uint8)


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return np.count_nonzero(a & b) / np.count_nonzero(a | b)


def test_an_ellipse_is_found_from_its_box():
    truth = ellipse((120, 90), (30, 60))
    people = GrabCut(GrabCutOptions(boxes=[(82, 22, 158, 158)])).infer(scene(truth))
    print(f"IoU {iou(people.masks[0], truth):.3f}")
    assert iou(people.masks[0], truth) > 0.97
    np.testing.assert_allclose(people.boxes[0], [90, 30, 151, 151], atol=2)
    assert 0.6 < people.scores[0] < 0.9  # the box was drawn loosely
    assert people.floor is None
    assert people.keypoints is None


def test_an_ellipse_is_found_from_points_on_it():
    truth = ellipse((120, 90), (30, 60))
    points = [(120.0, y) for y in (35, 60, 90, 120, 145)] + [(100, 90), (140, 90)]
    people = GrabCut(GrabCutOptions(keypoints=[points])).infer(scene(truth))
    print(f"IoU {iou(people.masks[0], truth):.3f}")
    assert iou(people.masks[0], truth) > 0.95


def test_limbs_are_followed_from_coco_keypoints():
    import cv2

    joints = {0: (120, 30), 5: (135, 60), 6: (105, 60), 7: (150, 80), 8: (90, 80), 9: (170, 70), 10: (70, 70)}
    joints |= {11: (130, 105), 12: (110, 105), 13: (135, 135), 14: (105, 135), 15: (140, 165), 16: (100, 165)}
    joints |= dict.fromkeys(range(1, 5), (120, 26))
    canvas = np.zeros((HEIGHT, WIDTH), np.uint8)
    for a, b in ((5, 7), (7, 9), (6, 8), (8, 10), (11, 13), (13, 15), (12, 14), (14, 16)):
        cv2.line(canvas, joints[a], joints[b], 1, 11)
    cv2.rectangle(canvas, (103, 52), (137, 110), 1, -1)
    cv2.circle(canvas, (120, 34), 15, 1, -1)
    truth = canvas > 0
    options = GrabCutOptions(keypoints=[[joints[i] for i in range(17)]], skeleton="coco17")
    people = GrabCut(options).infer(scene(truth))
    print(f"IoU {iou(people.masks[0], truth):.3f}")
    assert iou(people.masks[0], truth) > 0.9
    assert people.keypoints is not None
    assert people.keypoints.skeleton == "coco17"
    np.testing.assert_array_equal(people.keypoints.points[0, 9], [170, 70])


def test_two_people_share_no_pixel_and_come_best_score_first():
    near, far = ellipse((100, 110), (25, 50)), ellipse((135, 80), (22, 55))
    image = scene(near, far & ~near)
    people = GrabCut(GrabCutOptions(boxes=[(60, 20, 165, 140), (72, 56, 128, 164)])).infer(image)
    assert len(people) == 2
    first = 0 if people.boxes[0][3] > people.boxes[1][3] else 1
    print(f"IoU {iou(people.masks[first], near):.3f}, {iou(people.masks[1 - first], far & ~near):.3f}")
    assert iou(people.masks[first], near) > 0.75  # their colours are the same: the border between them is not seen
    assert iou(people.masks[1 - first], far & ~near) > 0.75
    assert not (people.masks[0] & people.masks[1]).any()
    assert people.scores[0] >= people.scores[1]


def test_a_large_photo_is_cut_on_a_reduced_crop():
    truth = ellipse((120, 90), (30, 60))
    large, whole = (x.repeat(4, axis=0).repeat(4, axis=1) for x in (scene(truth), truth))
    box = tuple(4.0 * x for x in (82, 22, 158, 158))
    people = GrabCut(GrabCutOptions(boxes=[box], working_px=200)).infer(large)
    print(f"IoU {iou(people.masks[0], whole):.3f}")
    assert people.masks.shape == (1, 4 * HEIGHT, 4 * WIDTH)
    assert iou(people.masks[0], whole) > 0.95


def test_a_box_in_which_nothing_stands_out_is_refused():
    with pytest.raises(BackendError) as caught:
        GrabCut(GrabCutOptions(boxes=[(80, 20, 160, 160)])).infer(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    assert str(caught.value) == (
        "GrabCut found nothing that stands out in the box [80.0, 20.0, 160.0, 160.0] px: draw the box round the whole "
        "person, with some background inside, or give keypoints."
    )
