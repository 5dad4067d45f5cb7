"""What backends may do wrong in a run: required ones stop it, the others cost a warning; each by
name.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from physic_core import load_config, reconstruct
from physic_core.errors import BackendOutputError
from physic_core.types import Reconstruction
from physic_mock import backends

pytestmark = pytest.mark.usefixtures("few_steps")

FILE = "tests/pipeline/test_failures_of_backends.py"


def run(world, interface, base, change):
    """The mocks, one of whose answers is changed."""

    def infer(self, *arguments):
        return change(base.infer(self, *arguments))

    return reconstruct(
        world.image, "mock", backends={interface: type("Wrong", (base,), {"infer": infer})}
    )


def fail(answer):
    raise RuntimeError("no weights\nin w.pt")


def nans(*names):
    """The fields of an answer, NaN everywhere."""
    return lambda answer: replace(
        answer, **{name: np.full_like(getattr(answer, name), np.nan) for name in names}
    )


def nan_parameters(answer):
    return replace(answer, parameters=nans("body_pose", "transl")(answer.parameters))


@pytest.mark.parametrize(
    ("interface", "base", "change", "faults"),
    [
        (
            *(
                "segmenter",
                backends.MockSegmenter,
                lambda a: replace(a, masks=a.masks.transpose(0, 2, 1)),
            ),
            ["masks must be (1, 120, 160), got (1, 160, 120)"],
        ),
        (
            *("body_estimator", backends.MockBodyEstimator, nan_parameters),
            ["body_pose must be finite", "transl must be finite"],
        ),
    ],
    ids=["segmenter", "body_estimator"],
)
def test_an_invalid_result_of_a_required_backend_stops_a_run(
    world, interface, base, change, faults
):
    with pytest.raises(BackendOutputError) as error:
        run(world, interface, base, change)
    assert all(fault in str(error.value) for fault in faults)


@pytest.fixture(scope="module")
def without(few_steps, world):
    """A function that gives the result without the backend of an interface."""

    @cache
    def run_without(interface):
        config = load_config(preset="mock", overrides=[f"{interface}.backend=none"])
        return reconstruct(world.image, config)

    return run_without


HANDS = (
    "hand_estimator",
    backends.MockHandEstimator,
    "hands",
    "fingers keep the pose from the body_estimator",
)
CONTACT = (
    "contact_prior",
    backends.MockContactPrior,
    "contact prior",
    "contact is computed from distances only",
)


def test_a_person_observer_that_fails_costs_a_warning_alone(world):
    result = run(world, "person_observer", backends.MockPersonObserver, nans("posture_share"))
    assert any("posture_share" in warning for warning in result.warnings)
    person = result.people[0]
    assert (person.posture, person.posture_probability, person.child_probability) == (None,) * 3
    assert not any("person_observer" in check.message for check in result.checks)


FAILS = f"RuntimeError: no weights in w.pt ({FILE}:{fail.__code__.co_firstlineno + 1})"


@pytest.mark.parametrize(
    ("optional", "change", "reason"),
    [
        (HANDS, fail, FAILS),
        (CONTACT, nans("probability"), "probability must lie in [0, 1], got nan to nan"),
        (CONTACT, lambda a: replace(a, topology="smpl"), "topology must be 'physic-embedded-1'"),
    ],
)
def test_a_run_goes_on_without_an_optional_backend_that_fails(
    world,
    optional,
    change,
    reason,
    tmp_path,
    without,
):
    interface, base, stage, consequence = optional
    result = run(world, interface, base, change)
    assert any(
        reason in warning and warning.endswith(f"; {consequence}") for warning in result.warnings
    )
    assert any(
        f"no valid values for this person from {interface}" in warning
        for warning in result.warnings
    )
    assert result.people[0].failed_checks[0] == "placed"
    plain = without(interface)
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)
    np.testing.assert_array_equal(result.people[0].contact, plain.people[0].contact)
    assert [s.name for s in result.stages if s.failed] == [stage]
    result.save(str(tmp_path), "numbers")
    assert Reconstruction.load(str(tmp_path)).stages == result.stages
