"""Each interface names every violation of a result: what was expected and what was returned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import interfaces
from physic_core.types import (
    Bodies,
    Carrier,
    ContactProbability,
    DepthMap,
    Hands,
    Intrinsics,
    Keypoints,
    Mesh,
    Observations,
    People,
    Pointmap,
    RestMesh,
    SurfaceLabels,
)
from physic_networks.bodies import parameters_from_rotvecs
from physic_testing import violations

H = 6
W = 8
CAMERA = Intrinsics.from_focal(9, W, H)
FACES = np.array([[0, 1, 2], [1, 2, 3]], np.int32)
MASKS = np.zeros((2, H, W), bool)
MASKS[0, 1:5, 1:3] = MASKS[1, 1:5, 4:6] = True
BOXES = np.array([[1, 1, 3, 5], [4, 1, 6, 5]], np.float32)
SURFACES = SurfaceLabels(np.zeros((H, W), np.uint8))
KEYPOINTS = Keypoints(np.ones((2, 17, 2)), np.full((2, 17), 0.5), "coco17", np.ones((2, 17, 3)))
PEOPLE = People(
    MASKS, BOXES, np.array([0.9, 0.8], np.float32), keypoints=KEYPOINTS, surfaces=SURFACES
)
RAYS = np.dstack([*np.mgrid[-3.0:3, -4.0:4][::-1], np.full((H, W), 9.0)]).astype(np.float32)
POINTMAP = Pointmap(np.ones((H, W, 3), np.float32), np.ones((H, W), bool), "scale", CAMERA)
UP = np.array([0.0, -1.0, 0.0])
DEPTH = DepthMap(np.ones((H, W), np.float32), CAMERA, 0.1)
PARAMETERS = parameters_from_rotvecs(np.zeros((2, 55, 3)), np.zeros((2, 10)), np.zeros((2, 3)))
MESH = Mesh("mhr", np.zeros((2, 4, 3), np.float32), FACES, np.zeros((4, 3), np.float32))
BODIES = Bodies(PARAMETERS, "mhr", None, np.zeros((2, 55, 3), np.float32), MESH)
HANDS = Hands(np.zeros((2, 2, 15, 3)), np.array([[0.5, 0.0], [0.9, 0.9]]), np.zeros((2, 2, 3)))
LOOKS = np.array([[0.6, 0.0, -0.8], [np.nan] * 3])
OBSERVED = replace(
    Observations.unknown(2),
    posture=np.stack([np.full(9, 1 / 9), np.full(9, np.nan)]),
    posture_share=np.eye(9)[0],
    child=np.array([0.0, 1.0]),
    child_share=0.1,
)
CONTACT = ContactProbability(np.zeros((2, 4)), "smpl", RestMesh("smpl", np.zeros((4, 3)), FACES))

INTERFACES = {
    People: (interfaces.Segmenter, {"height": H, "width": W}),
    Keypoints: (interfaces.KeypointDetector, {"people": 2}),
    Pointmap: (interfaces.RelativePointmap, {"height": H, "width": W}),
    DepthMap: (interfaces.MetricDepth, {"height": H, "width": W}),
    Bodies: (interfaces.BodyEstimator, {"people": 2}),
    Hands: (interfaces.HandEstimator, {"people": 2}),
    Observations: (interfaces.PersonObserver, {"people": 2}),
    ContactProbability: (
        interfaces.ContactPrior,
        {"people": 2, "vertices": 9, "topology": "embedded"},
    ),
}


def found_in(result, **context):
    interface, usual = INTERFACES[type(result)]
    return violations(interface, result, **usual | context)


def nan_at(array, *index):
    """A copy with NaN at an index, everywhere without one."""
    copy = np.array(array)
    copy[index or ...] = np.nan
    return copy


def mesh(*values):
    return {"mesh": Mesh("mhr", *values)}


def parameters(**values):
    return {"parameters": replace(PARAMETERS, **values)}


@pytest.mark.parametrize(
    ("result", "changes"),
    [
        (PEOPLE, {"keypoints": None, "surfaces": None}),
        (PEOPLE, {"carriers": (Carrier("ski", (0.0, 0.0, 2.0, 2.0), 0.5),)}),
        (PEOPLE, {"surfaces": SurfaceLabels(np.ones((H, W), np.uint8), ("wall", "floor"))}),
        (
            PEOPLE,
            {
                "masks": MASKS[:0],
                "boxes": BOXES[:0],
                "scores": np.zeros(0, np.float32),
                "keypoints": None,
            },
        ),
        (KEYPOINTS, {"sigma": np.full((2, 17), 3.0), "depth_sigma": np.full((2, 17), 0.07)}),
        (POINTMAP, {"up": np.array([0.0, -0.8, 0.6]), "up_sigma": 2.0, "up_source": "lines"}),
        (PEOPLE, {"boxes": np.array([[0, 0, 8, 6], [3, 0, 7, 6]], np.float32)}),
        (DEPTH, {"scale_sigma": np.float32(0.1), "notes": ["a"]}),
        (BODIES, mesh(MESH.vertices, FACES.astype(np.uint32))),
        (BODIES, {"joints": None, "mesh": None, "body_model": "embedded"}),
        (BODIES, {"rotation_sigma": nan_at(np.full((2, 22), 0.2), 0)}),
        # not found
        (HANDS, {"rotvecs": nan_at(HANDS.rotvecs), "confidence": np.zeros((2, 2)), "wrists": None}),
        (OBSERVED, {"head": LOOKS, "head_sigma": np.array([8.0, np.nan])}),
        (Observations.unknown(2), {}),
        # What is lost for some people only is handled for each: see
        # physic_core.pipeline.backend_results.
        (
            KEYPOINTS,
            {
                "confidence": nan_at(KEYPOINTS.confidence, 0, 3),
                "world": nan_at(KEYPOINTS.world, 0, 3),
            },
        ),
        (
            BODIES,
            parameters(transl=nan_at(PARAMETERS.transl, 1)) | {"joints": nan_at(BODIES.joints, 1)},
        ),
        (BODIES, mesh(nan_at(MESH.vertices, 0, 2), FACES)),
        (CONTACT, {"probability": nan_at(CONTACT.probability, 1)}),
    ],
)
def test_valid_results_have_no_violation(result, changes):
    assert found_in(replace(result, **changes)) == []


@pytest.mark.parametrize(
    ("result", "changes", "expected"),
    [
        (
            PEOPLE,
            {"masks": None, "keypoints": None},
            ["masks must be a numpy array (0, 6, 8), got NoneType", ...],
        ),
        (PEOPLE, {"masks": np.ones((2, H, W), bool)}, "masks of two people overlap..."),
        (
            PEOPLE,
            {"boxes": np.array([[2, 1, 2, 4], [6, 1, 14, 5]], np.float32)},
            "boxes must be x0 y0 x1 y1...",
        ),
        (PEOPLE, {"scores": np.array([90.0, 80.0])}, "scores must lie in [0, 1], got 0 to 90"),
        (
            PEOPLE,
            {"surfaces": replace(SURFACES, names=("floor", "lava"))},
            "surfaces.names has 'lava'; the...",
        ),
        (
            PEOPLE,
            {"surfaces": SurfaceLabels(np.full((H, W), 2, np.uint8), ("wall",))},
            "surfaces.labels must be...",
        ),
        (
            PEOPLE,
            {"carriers": (Carrier("hovercraft", (0.0, 0.0, 2.0, 2.0), 0.5),)},
            "carriers has 'hovercraft'; the...",
        ),
        (
            KEYPOINTS,
            {"skeleton": 17},
            ["skeleton must be a Skeleton or the name of a standard one, got int", ...],
        ),
        (KEYPOINTS, {"sigma": np.zeros((2, 17))}, "sigma must be above 0 where confidence is"),
        (
            POINTMAP,
            {"points": nan_at(POINTMAP.points)},
            "points must be finite, 144 values are not",
        ),
        (
            POINTMAP,
            {"points": -POINTMAP.points},
            "z must be > 0 where valid (z forward), 100% of the valid points...",
        ),
        (POINTMAP, {"valid": np.zeros((H, W), bool)}, "no pixel is valid"),
        (POINTMAP, {"points": RAYS * [1, -1, 1]}, "y must grow with the rows..."),
        (
            POINTMAP,
            {"unknown": "metres"},
            "unknown must be one of scale, scale_shift, inverse_scale_shift...",
        ),
        (POINTMAP, {"up": UP}, "up_sigma must be degrees, > 0 and < 90, got None"),
        (POINTMAP, {"up": 2 * UP, "up_sigma": 1.0}, "up must be a vector (3,) of length 1..."),
        (
            POINTMAP,
            {"intrinsics": replace(CAMERA, cx=np.nan)},
            "intrinsics must be finite numbers fx, fy, cx...",
        ),
        (
            DEPTH,
            {"intrinsics": CAMERA.resized(16, 12)},
            "intrinsics must be for 8 x 6 px, got 16 x 12",
        ),
        (DEPTH, {"notes": "text"}, "notes must be a tuple of texts, got 'text'"),
        (DEPTH, {"depth": nan_at(DEPTH.depth)}, "depth is NaN or infinite everywhere"),
        (DEPTH, {"depth": -DEPTH.depth}, "depth must be > 0 m or NaN, the smallest is -1"),
        (
            DEPTH,
            {"depth": torch.ones((H, W))},
            "depth must be a numpy array (6, 8), got Tensor...",
        ),
        (BODIES, {"parameters": {}}, ["parameters must be BodyParameters, got dict", ...]),
        (BODIES, {"joints": np.zeros((2, 55, 3), int)}, "joints must be float, got int64"),
        (
            HANDS,
            {"rotvecs": HANDS.rotvecs + 20},
            "rotvecs must lie within +-6.28319 rad, got 20...",
        ),
        (
            BODIES,
            {"rotation_sigma": np.full((2, 22), 20.0)},
            "rotation_sigma must be within 0 and pi radians...",
        ),
        (
            BODIES,
            mesh(MESH.vertices, FACES + 1),
            "mesh.faces must number the 4 vertices from 0, got 1 to 4",
        ),
        (
            OBSERVED,
            {"touch": np.zeros((2, 4)), "child_share": None},
            [
                "touch must be (2, 10, 5), got (2, 4)",
                "child_share must be a number or NaN, got None",
            ],
        ),
        (
            OBSERVED,
            {"posture": nan_at(OBSERVED.posture, 0, 3)},
            "each row of posture, and posture_share, must sum to 1...",
        ),
        (
            OBSERVED,
            {"on_floor": np.array([[np.nan, 0.5]] * 2)},
            "on_floor_share must lie between 0 and 1 where on_floor is given, got [nan nan]",
        ),
        (OBSERVED, {"child_share": 1.0}, "child_share must lie between 0 and 1 where..."),
        (
            OBSERVED,
            {"head": 2 * LOOKS, "head_sigma": np.full(2, 8.0)},
            "each row of head must be a unit vector, or NaN",
        ),
        (CONTACT, {"rest": None}, "topology must be 'embedded' as the bodies', got 'smpl'"),
    ],
)
def test_a_violation_says_what_was_expected_and_what_came(result, changes, expected):
    """``...`` stands for the end of a text, or for further violations."""
    found = found_in(replace(result, **changes))
    expected = [expected] if isinstance(expected, str) else expected
    if expected[-1] is ...:
        expected = expected[:-1]
        found = found[: len(expected)]
    assert len(found) == len(expected), found
    for text, wanted in zip(found, expected, strict=True):
        assert text.startswith(wanted[:-3]) if wanted.endswith("...") else text == wanted


@pytest.mark.parametrize(
    ("boxes", "notation"),
    [
        (np.hstack([BOXES[:, :2], BOXES[:, 2:] - BOXES[:, :2]]), "x, y, width, height"),
        (np.hstack([BOXES[:, :2] + [1, 2], [[2, 4], [2, 4]]]), "center, width, height"),
        (BOXES[:, [1, 0, 3, 2]], "y0, x0, y1, x1"),
        (BOXES / [W, H, W, H], "shares of the image"),
    ],
)
def test_boxes_in_another_notation_are_refused_by_its_name(boxes, notation):
    (text,) = found_in(replace(PEOPLE, boxes=boxes.astype(np.float32)))
    assert text.endswith(f"they look like {notation}")


def test_keypoints_of_another_number_of_people():
    points, confidence = found_in(replace(KEYPOINTS, world=None), people=3)
    assert "(3, 17, 2), got (2, 17, 2)" in points
    assert "(3, 17), got (2, 17)" in confidence


def test_the_mask_of_surfaces_takes_every_name_of_the_vocabulary():
    labels = SurfaceLabels(np.array([[0, 1], [1, 2]], np.uint8), ("wall", "floor", "rug"))
    assert labels.mask("floor", "rug", "bed").tolist() == [[False, True], [True, True]]
    with pytest.raises(ValueError, match=r"^no surface is named 'lava'"):
        labels.mask("floor", "lava")
