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
from physic_core.types import Bodies, Intrinsics, Reconstruction
from physic_mock import backends
from physic_testing.worlds import World

pytestmark = pytest.mark.usefixtures("few_steps")

WRONG = "{} 'wrong' (registered by hand), stage '{}'"
WRONGLY = " returned what the interface does not allow"
FILE = "tests/pipeline/test_failures_of_backends.py"


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


@pytest.mark.parametrize(
    ("interface", "stage", "base", "change", "faults"),
    [
        (
            *("segmenter", "people", backends.MockSegmenter, lambda a: replace(a, masks=a.masks.transpose(0, 2, 1))),
            ["masks must be (1, 120, 160), got (1, 160, 120)"],
        ),
        (
            *("inpainter", "inpainting", backends.MockInpainter, lambda a: np.full(a.shape, np.nan)),
            ["image must be uint8, got float64"],
        ),
        (
            *("segmenter", "people", backends.MockSegmenter, lambda a: replace(a, floor=a.floor.T)),
            ["floor must be (120, 160), got (160, 120)"],
        ),
        (
            *("segmenter", "people", backends.MockSegmenter, lambda a: replace(a, floor="wood")),
            ["floor must be a numpy array (120, 160), got str"],
        ),
        (
            *("body_estimator", "bodies", backends.MockBodyEstimator, nan_parameters),
            ["body_pose must be finite, 63 values are not", "transl must be finite, 3 values are not"],
        ),
        (
            *("relative_pointmap", "scene point map", backends.MockRelativePointmap),
            lambda a: replace(a, intrinsics=Intrinsics.from_focal(500, 640, 480)),
            ["intrinsics must be for 160 x 120 px, got 640 x 480"],
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_invalid_result_of_a_required_backend_stops_a_run(
    world: World, interface: str, stage: str, base: type, change: Callable[[Any], Any], faults: list[str]
) -> None:
    with pytest.raises(BackendOutputError) as error:
        run(world, interface, base, change)
    title = WRONG.format(interface, stage)
    assert str(error.value) == "\n  ".join([f"{title}{WRONGLY}:", *faults])


def without(world: World, interface: str) -> Reconstruction:
    return reconstruct(world.image, load_config(preset="mock", overrides=[f"{interface}.backend=none"]))


ANSWERED = "person 0: no valid values for this person from {}: results that need them are skipped; try another backend"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (fail, f": RuntimeError: no weights in w.pt ({FILE}:{fail.__code__.co_firstlineno + 1})"),
        (nans("rotvecs", "confidence"), f"{WRONGLY}: confidence must lie in [0, 1], got nan to nan"),
        (lambda a: None, f"{WRONGLY}: expected Hands, got NoneType"),
    ],
    ids=["fails", "NaN", "nothing"],
)
def test_without_hands_the_fingers_stay_as_they_were(
    world: World, change: Callable[[Any], Any], reason: str, tmp_path: Path
) -> None:
    result = run(world, "hand_estimator", backends.MockHandEstimator, change)
    title = WRONG.format("hand_estimator", "hands")
    assert f"{title}{reason}; fingers keep the pose from the body_estimator" in result.warnings
    assert ANSWERED.format("hand_estimator") in result.warnings
    assert result.people[0].failed_checks[0] == "missing_outputs"
    plain = without(world, "hand_estimator")
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)
    assert [s.name for s in result.stages if s.failed] == ["hands"]
    result.save(str(tmp_path), "numbers")
    stages = json.loads((tmp_path / "reconstruction.json").read_text())["stages"]
    assert [s["name"] for s in stages if s["failed"]] == ["hands"]
    assert Reconstruction.load(str(tmp_path)).stages == result.stages


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (fail, f": RuntimeError: no weights in w.pt ({FILE}:{fail.__code__.co_firstlineno + 1})"),
        (nans("probability"), f"{WRONGLY}: probability must lie in [0, 1], got nan to nan"),
        (
            lambda a: replace(a, topology="smpl"),
            f"{WRONGLY}: topology must be 'physic-embedded-1' as the bodies', got 'smpl'",
        ),
    ],
    ids=["fails", "NaN", "another mesh"],
)
def test_without_a_contact_prior_distances_tell_contact(
    world: World, change: Callable[[Any], Any], reason: str
) -> None:
    result = run(world, "contact_prior", backends.MockContactPrior, change)
    title = WRONG.format("contact_prior", "contact prior")
    assert f"{title}{reason}; contact is computed from distances only" in result.warnings
    assert ANSWERED.format("contact_prior") in result.warnings
    plain = without(world, "contact_prior")
    np.testing.assert_array_equal(result.people[0].contact, plain.people[0].contact)
