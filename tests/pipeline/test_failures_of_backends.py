"""What backends may do wrong in a run: required ones stop it, the others cost a warning; each by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core import load_config, reconstruct
from physic_core.discovery.plugins import discover
from physic_core.discovery.registry import BackendRecord
from physic_core.errors import BackendOutputError
from physic_core.interfaces import BodyEstimator, KeypointDetector, MetricDepth, RelativePointmap, Segmenter
from physic_core.types import (
    Bodies,
    BodyParameters,
    DepthMap,
    Intrinsics,
    Keypoints,
    People,
    Pointmap,
    Reconstruction,
)
from physic_mock import backends
from physic_testing import violations
from physic_testing.worlds import World, build_world

pytestmark = pytest.mark.usefixtures("few_steps")

WRONG = "{} 'wrong' (registered by hand), stage '{}'"
FILE = "tests/pipeline/test_failures_of_backends.py"


@pytest.fixture(scope="module")
def world() -> World:
    return build_world("stand", 0, (160, 120))


def run(world: World, interface: str, base: type, change: Callable[[Any], Any]) -> Reconstruction:
    """The mocks, one of whose answers is changed."""

    def infer(self, *arguments):
        return change(base.infer(self, *arguments))

    registry = discover()
    registry.register(BackendRecord(interface, "wrong", type("Wrong", (base,), {"infer": infer}), api=1))
    return reconstruct(
        world.image, load_config(preset="mock", overrides=[f"{interface}.backend=wrong"]), registry=registry
    )


def fail(answer: object) -> object:
    raise RuntimeError("no weights\nin w.pt")


def nans(*names: str) -> Callable[[Any], Any]:
    """The fields of an answer, NaN everywhere."""
    return lambda answer: replace(answer, **{name: np.full_like(getattr(answer, name), np.nan) for name in names})


def nan_parameters(answer: Bodies) -> Bodies:
    return replace(answer, parameters=nans("body_pose", "transl")(answer.parameters))


# ---- required --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interface", "stage", "base", "change", "faults"),
    [
        (
            *("segmenter", "people", backends.MockSegmenter, nans("boxes", "scores")),
            ["scores must lie in [0, 1], got nan to nan", "boxes must be finite, 4 values are not"],
        ),
        (
            *("segmenter", "people", backends.MockSegmenter, lambda a: replace(a, masks=a.masks.transpose(0, 2, 1))),
            ["masks must be (1, 120, 160), got (1, 160, 120)"],
        ),
        (
            *("keypoint_detector", "keypoints", backends.MockKeypointDetector, nans("points", "confidence")),
            ["confidence must lie in [0, 1], got nan to nan"],
        ),
        (
            *("inpainter", "inpainting", backends.MockInpainter, lambda a: np.full(a.shape, np.nan)),
            ["image must be uint8, got float64"],
        ),
        (
            *("relative_pointmap", "scene point map", backends.MockRelativePointmap, nans("points")),
            ["points must be finite, 57600 values are not"],
        ),
        (
            *("body_estimator", "bodies", backends.MockBodyEstimator, nan_parameters),
            ["body_pose must be finite, 63 values are not", "transl must be finite, 3 values are not"],
        ),
        (
            *("metric_depth", "metric depth", backends.MockMetricDepth, nans("depth")),
            ["depth is NaN or infinite everywhere"],
        ),
        (
            *("relative_pointmap", "scene point map", backends.MockRelativePointmap),
            lambda a: replace(a, intrinsics=Intrinsics.from_focal(500, 640, 480)),
            ["intrinsics must be for 160 x 120 px, got 640 x 480"],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_nan_everywhere_stops_a_run_that_needs_the_answer(
    world: World, interface: str, stage: str, base: type, change: Callable[[Any], Any], faults: list[str]
) -> None:
    with pytest.raises(BackendOutputError) as error:
        run(world, interface, base, change)
    title = WRONG.format(interface, stage)
    assert str(error.value) == "\n  ".join([f"{title} returned what the interface does not allow:", *faults])


# ---- optional --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sound(world: World) -> Reconstruction:
    return reconstruct(world.image, "mock")


def without(world: World, interface: str) -> Reconstruction:
    return reconstruct(world.image, load_config(preset="mock", overrides=[f"{interface}.backend=none"]))


ANSWERED = "person 0: no valid values for this person from {}: results that need them are left out; try another backend"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            fail,
            f": RuntimeError: no weights in w.pt ({FILE}:{fail.__code__.co_firstlineno + 1})",
        ),
        (
            nans("rotvecs", "confidence"),
            " returned what the interface does not allow: confidence must lie in [0, 1], got nan to nan",
        ),
        (lambda a: None, " returned what the interface does not allow: expected Hands, got NoneType"),
    ],
    ids=["fails", "NaN", "nothing"],
)
def test_without_hands_the_fingers_stay_as_they_were(
    world: World, change: Callable[[Any], Any], told: str, tmp_path: Path
) -> None:
    result = run(world, "hand_estimator", backends.MockHandEstimator, change)
    title = WRONG.format("hand_estimator", "hands")
    assert f"{title}{told}; fingers stay as the body_estimator posed them" in result.warnings
    assert ANSWERED.format("hand_estimator") in result.warnings
    assert result.people[0].failed_checks[0] == "missing_outputs"
    plain = without(world, "hand_estimator")
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)
    assert [s.name for s in result.stages if s.failed] == ["hands"]
    result.save(str(tmp_path), preview=False)
    stages = json.loads((tmp_path / "reconstruction.json").read_text())["stages"]
    assert [s["name"] for s in stages if s["failed"]] == ["hands"]
    assert Reconstruction.load(str(tmp_path)).stages == result.stages


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            fail,
            f": RuntimeError: no weights in w.pt ({FILE}:{fail.__code__.co_firstlineno + 1})",
        ),
        (
            nans("probability"),
            " returned what the interface does not allow: probability must lie in [0, 1], got nan to nan",
        ),
        (
            lambda a: replace(a, topology="smpl"),
            " returned what the interface does not allow: topology must be 'physic-embedded-1' as the bodies', "
            "got 'smpl'",
        ),
    ],
    ids=["fails", "NaN", "another mesh"],
)
def test_without_a_contact_prior_distances_tell_contact(world: World, change: Callable[[Any], Any], told: str) -> None:
    result = run(world, "contact_prior", backends.MockContactPrior, change)
    title = WRONG.format("contact_prior", "contact prior")
    assert f"{title}{told}; contact is computed from distances alone" in result.warnings
    assert ANSWERED.format("contact_prior") in result.warnings
    plain = without(world, "contact_prior")
    np.testing.assert_array_equal(result.people[0].contact, plain.people[0].contact)


@pytest.mark.parametrize(
    ("floor", "fault"),
    [
        (np.zeros((160, 120), bool), "floor must be (120, 160), got (160, 120)"),
        (np.full((120, 160), np.nan), "floor must be bool, got float64"),
        ("wood", "floor must be a numpy array (120, 160), got str"),
    ],
    ids=["transposed", "NaN", "a word"],
)
def test_without_a_mask_the_floor_is_sought_all_the_same(world: World, floor: object, fault: str) -> None:
    result = run(world, "segmenter", backends.MockSegmenter, lambda a: replace(a, floor=floor))
    title = WRONG.format("segmenter", "people")
    assert (
        f"{title} returned what the interface does not allow: {fault}; the floor is searched without its mask"
        in result.warnings
    )
    plain = run(world, "segmenter", backends.MockSegmenter, lambda a: replace(a, floor=None))
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)


# ---- the border, field by field --------------------------------------------------------------------------------------

H, W = 6, 8
CAMERA = Intrinsics.from_focal(9, W, H)
KEYPOINTS = Keypoints(np.ones((2, 17, 2)), np.ones((2, 17)), "coco17", np.ones((2, 17, 3)))
PEOPLE = People(np.ones((1, H, W), bool), np.array([[0, 0, 8, 6.0]]), np.ones(1))
POINTMAP = Pointmap(np.ones((H, W, 3)), np.ones((H, W), bool), "scale", CAMERA)
DEPTH = DepthMap(np.ones((H, W)), CAMERA, 0.1)
WIDTHS = {"global_orient": 3, "body_pose": 63, "left_hand_pose": 45, "right_hand_pose": 45, "jaw_pose": 3}
WIDTHS |= {"leye_pose": 3, "reye_pose": 3, "betas": 10, "expression": 0, "transl": 3}
BODIES = Bodies(BodyParameters(**{name: np.zeros((2, width)) for name, width in WIDTHS.items()}), "embedded")


def camera(**changes: Any) -> dict[str, Any]:
    return {"intrinsics": replace(CAMERA, **changes)}


def one_nan(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[0, 3] = np.nan
    return array


@pytest.mark.parametrize(
    ("answer", "changes", "faults"),
    [
        (KEYPOINTS, {"points": None}, ["points must be a numpy array (2, 0, 2), got NoneType"]),
        (KEYPOINTS, {"skeleton": 17}, ["skeleton must be a Skeleton or the name of a standard one, got int"]),
        (KEYPOINTS, {"world": KEYPOINTS.world * np.nan}, ["world must be finite, 102 values are not"]),  # type: ignore[operator]
        (KEYPOINTS, {"world": one_nan(np.ones((2, 17, 3)))}, []),  # of one person: salvage
        (
            *(POINTMAP, {"unknown": "metres"}),
            ["unknown must be one of scale, scale_shift, inverse_scale_shift, got 'metres'"],
        ),
        (POINTMAP, {"intrinsics": np.eye(3)}, ["intrinsics must be Intrinsics, got ndarray"]),
        (POINTMAP, {"shift_sigma": -0.1}, ["shift_sigma must be finite and at least 0, or None, got -0.1"]),
        (
            *(POINTMAP, camera(fx=np.nan)),
            ["intrinsics must be finite numbers fx, fy, cx, cy with fx > 0 and fy > 0, got nan, 9, 3.5, 2.5"],
        ),
        (
            *(DEPTH, camera(fy=-9)),
            ["intrinsics must be finite numbers fx, fy, cx, cy with fx > 0 and fy > 0, got 9, -9, 3.5, 2.5"],
        ),
        (DEPTH, camera(width=16, height=12), ["intrinsics must be for 8 x 6 px, got 16 x 12"]),
        (DEPTH, camera(source=None), ["intrinsics.source must be str, got NoneType"]),
        (DEPTH, {"scale_sigma": np.nan}, ["scale_sigma must be a number from 0 to 1000 or None, got nan"]),
        (DEPTH, {"scale_sigma": np.float32(0.1), "notes": ["a"]}, []),
        (DEPTH, {"notes": "text"}, ["notes must be a tuple of texts, got 'text'"]),
        (PEOPLE, {"masks": None}, ["masks must be a numpy array (0, 6, 8), got NoneType"]),
        (PEOPLE, {"keypoints": np.ones(3)}, ["keypoints must be Keypoints, got ndarray"]),
        (BODIES, {"parameters": {}, "body_model": None}, [
            "parameters must be BodyParameters, got dict", "body_model must be str, got NoneType"
        ]),
        (BODIES, {"parameters": replace(BODIES.parameters, betas=None)}, [
            "betas must be a numpy array (2, 0), got NoneType"
        ]),
    ],
    ids=str,
)  # fmt: skip
def test_a_violation_states_what_came(answer: Any, changes: dict[str, Any], faults: list[str]) -> None:
    told = {
        People: lambda a: violations(Segmenter, a, height=H, width=W),
        Keypoints: lambda a: violations(KeypointDetector, a, people=2),
        Pointmap: lambda a: violations(RelativePointmap, a, height=H, width=W),
        DepthMap: lambda a: violations(MetricDepth, a, height=H, width=W),
        Bodies: lambda a: violations(BodyEstimator, a, people=2),
    }[type(answer)]
    assert told(answer) == []
    assert told(replace(answer, **changes))[: len(faults) or 1] == faults
