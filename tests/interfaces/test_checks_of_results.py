"""Each interface names every violation of a result: what was expected and what was returned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core.interfaces import (
    BodyEstimator,
    ContactPrior,
    HandEstimator,
    Inpainter,
    KeypointDetector,
    MetricDepth,
    RelativePointmap,
    Segmenter,
)
from physic_core.types import (
    Bodies,
    BodyParameters,
    ContactProbability,
    DepthMap,
    Hands,
    Keypoints,
    People,
    Pointmap,
    SurfaceLabels,
)
from physic_testing import violations

H, W = 97, 131


def people() -> People:
    masks = np.zeros((2, H, W), bool)
    masks[0, 10:50, 20:40] = True
    masks[1, 10:50, 60:80] = True
    boxes = np.array([[20, 10, 40, 50], [60, 10, 80, 50]], np.float32)
    return People(masks, boxes, np.array([0.9, 0.8], np.float32))


def keypoints() -> Keypoints:
    return Keypoints(np.full((2, 17, 2), 30.0), np.full((2, 17), 0.5), "coco17")


def parameters() -> BodyParameters:
    def zeros(width: int) -> np.ndarray:
        return np.zeros((2, width), np.float32)

    return BodyParameters(
        zeros(3), zeros(63), zeros(45), zeros(45), zeros(3), zeros(3), zeros(3), zeros(16), zeros(0), zeros(3)
    )


def test_valid_results_have_no_violations() -> None:
    points = np.ones((H, W, 3), np.float32)
    assert violations(Segmenter, people(), height=H, width=W) == []
    assert violations(Segmenter, replace(people(), keypoints=keypoints()), height=H, width=W) == []
    assert violations(KeypointDetector, keypoints(), people=2) == []
    assert violations(RelativePointmap, Pointmap(points, np.ones((H, W), bool), "scale"), height=H, width=W) == []
    assert violations(MetricDepth, DepthMap(points[..., 0]), height=H, width=W) == []
    assert violations(BodyEstimator, Bodies(parameters(), "embedded"), people=2) == []
    assert violations(HandEstimator, Hands(np.zeros((2, 2, 15, 3)), np.zeros((2, 2))), people=2) == []
    assert violations(ContactPrior, ContactProbability(np.zeros((2, 9)), "t"), people=2, vertices=9, topology="t") == []
    assert violations(Inpainter, np.zeros((H, W, 3), np.uint8), height=H, width=W) == []


def test_no_people_are_a_valid_result() -> None:
    nobody = People(np.zeros((0, H, W), bool), np.zeros((0, 4), np.float32), np.zeros(0, np.float32))
    assert violations(Segmenter, nobody, height=H, width=W) == []


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"masks": np.zeros((2, W, H), bool)}, "masks must be (2, 97, 131), got (2, 131, 97)"),
        ({"masks": np.zeros((2, H, W), np.uint8)}, "masks must be bool, got uint8"),
        ({"masks": np.zeros((2, H, W), bool)}, "every person needs at least one pixel, masks [0, 1] are empty"),
        ({"masks": np.ones((2, H, W), bool)}, "masks of two people overlap: every pixel belongs to one person at most"),
        (
            {"boxes": np.array([[20, 10, 20, 40], [60, 10, 140, 50]], np.float32)},
            "boxes must be x0 y0 x1 y1 inside the 131 x 97 px image, got [20.0, 10.0, 20.0, 40.0]",
        ),
        ({"scores": np.array([90.0, 80.0])}, "scores must lie in [0, 1], got 0 to 90"),
        ({"floor": np.zeros((H, W), np.float32)}, "floor must be bool, got float32"),
    ],
)
def test_people(change: dict[str, np.ndarray], fault: str) -> None:
    assert violations(Segmenter, replace(people(), **change), height=H, width=W) == [fault]


@pytest.mark.parametrize(
    ("depth", "fault"),
    [
        (np.full((H, W), np.nan, np.float32), "depth is NaN or infinite everywhere"),
        (np.full((H, W), -1, np.float32), "depth must be > 0 m or NaN, the smallest is -1"),
        (np.ones((1, H, W), np.float32), "depth must be (97, 131), got (1, 97, 131)"),
        ([[1.0]], "depth must be a numpy array (97, 131), got list"),
        (
            torch.ones((H, W)),
            "depth must be a numpy array (97, 131), got Tensor: write .detach().cpu().numpy()",
        ),
    ],
)
def test_depth(depth: np.ndarray, fault: str) -> None:
    assert violations(MetricDepth, DepthMap(depth), height=H, width=W) == [fault]


def test_pointmap_behind_the_camera() -> None:
    points = np.ones((H, W, 3), np.float32)
    points[..., 2] = -1
    assert violations(RelativePointmap, Pointmap(points, np.ones((H, W), bool), "scale"), height=H, width=W) == [
        "z must be > 0 where valid (z forward), 100% of the valid points lie behind"
    ]


def test_pointmap_without_a_valid_pixel() -> None:
    empty = Pointmap(np.ones((H, W, 3), np.float32), np.zeros((H, W), bool), "scale")
    assert violations(RelativePointmap, empty, height=H, width=W) == ["no pixel is valid"]


def test_bodies() -> None:
    wrong = replace(parameters(), body_pose=np.zeros((2, 69), np.float32), transl=np.full((2, 3), np.nan))
    assert violations(BodyEstimator, Bodies(wrong, "embedded"), people=2) == [
        "body_pose must be (2, 63), got (2, 69)",
        "transl must be finite, 6 values are not",
    ]


def test_numbers_that_are_lost_for_some_people_only_are_no_fault() -> None:
    """They are dealt with one by one; see physic_core.pipeline.invalid_results."""
    transl = np.zeros((2, 3), np.float32)
    transl[1] = np.nan
    assert violations(BodyEstimator, Bodies(replace(parameters(), transl=transl), "embedded"), people=2) == []
    confidence = np.full((2, 17), 0.5, np.float32)
    confidence[0, 3] = np.nan
    assert violations(KeypointDetector, replace(keypoints(), confidence=confidence), people=2) == []
    confidence[1, 3] = 7
    assert violations(KeypointDetector, replace(keypoints(), confidence=confidence), people=2) == [
        "confidence must lie in [0, 1], got 0 to 7"
    ]
    confidence[:] = np.nan
    assert violations(KeypointDetector, replace(keypoints(), confidence=confidence), people=2) == [
        "confidence must lie in [0, 1], got nan to nan"
    ]
    probability = np.full((2, 5), 0.5)
    probability[1] = np.nan
    assert violations(ContactPrior, ContactProbability(probability, "t"), people=2, vertices=5, topology="t") == []
    rotvecs = np.zeros((2, 2, 15, 3))
    rotvecs[0] = np.nan
    assert violations(HandEstimator, Hands(rotvecs, np.full((2, 2), 0.9)), people=2) == []
    rotvecs[1] = np.nan
    assert violations(HandEstimator, Hands(rotvecs, np.full((2, 2), 0.9)), people=2) == [
        "rotvecs must be finite, 180 values are not"
    ]


def surfaces() -> SurfaceLabels:
    return SurfaceLabels(np.zeros((H, W), np.uint8))


def test_surfaces_are_optional_and_indices_into_known_names() -> None:
    for valid in (None, surfaces(), SurfaceLabels(surfaces().labels + np.uint8(1), ("wall", "floor"))):
        assert violations(Segmenter, replace(people(), surfaces=valid), height=H, width=W) == []


@pytest.mark.parametrize(
    ("wrong", "violation"),
    [
        (SurfaceLabels(np.zeros((H, W), np.int64)), "surfaces.labels must be uint8, got int64"),
        (SurfaceLabels(np.zeros((H, 2), np.uint8)), f"surfaces.labels must be ({H}, {W}), got ({H}, 2)"),
        (replace(surfaces(), names=("floor", "lava")), "surfaces.names has 'lava'; the names of surfaces are "),
        (replace(surfaces(), names=("floor", "floor")), "surfaces.names must not name a surface twice"),
        (replace(surfaces(), names=["floor"]), "surfaces.names must be a tuple of texts, got ['floor']"),
        (SurfaceLabels(np.full((H, W), 2, np.uint8), ("wall",)), "surfaces.labels must be below the 1 names, got 2"),
        (np.zeros((H, W), np.uint8), "surfaces must be SurfaceLabels, got ndarray"),
    ],
)
def test_wrong_surfaces(wrong: SurfaceLabels, violation: str) -> None:
    (found,) = violations(Segmenter, replace(people(), surfaces=wrong), height=H, width=W)
    assert found.startswith(violation)


def test_the_mask_of_surfaces_takes_every_name_of_the_vocabulary() -> None:
    labels = SurfaceLabels(np.array([[0, 1], [1, 2]], np.uint8), ("wall", "floor", "rug"))
    assert labels.mask("floor", "rug", "bed").tolist() == [[False, True], [True, True]]
    with pytest.raises(ValueError, match=r"^no surface is named 'lava': use unknown, floor, ground, "):
        labels.mask("floor", "lava")


def test_keypoints_of_another_number_of_people() -> None:
    assert violations(KeypointDetector, keypoints(), people=3) == [
        "points must be (3, 17, 2), got (2, 17, 2)",
        "confidence must be (3, 17), got (2, 17)",
    ]


def test_contact_on_another_mesh() -> None:
    wrong = ContactProbability(np.zeros((2, 6890)), "smpl")
    assert violations(ContactPrior, wrong, people=2, vertices=10475, topology="smplx") == [
        "topology must be 'smplx' as the bodies', got 'smpl'"
    ]


def test_unseen_hand_may_hold_anything() -> None:
    hands = Hands(np.full((2, 2, 15, 3), np.nan), np.zeros((2, 2)))
    assert violations(HandEstimator, hands, people=2) == []
