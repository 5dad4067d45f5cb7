"""What backends may do wrong in a run: required ones stop it, the others cost a warning; each by
name.
"""

from __future__ import annotations

import signal
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from physic_core.errors import BackendOutputError
from physic_core.types import Reconstruction
from physic_mock import backends
from tests.pipeline.mocks import changed, run

pytestmark = pytest.mark.usefixtures("few_steps")

FILE = "tests/pipeline/test_failures_of_backends.py"


def fail(*_):
    raise RuntimeError("no weights\nin w.pt")


def nans(*names):
    """The fields of an answer, NaN everywhere."""
    return lambda answer, *_: replace(
        answer, **{name: np.full_like(getattr(answer, name), np.nan) for name in names}
    )


def nan_parameters(answer, *_):
    return replace(answer, parameters=nans("body_pose", "transl")(answer.parameters))


@pytest.mark.parametrize(
    ("kind", "change", "faults"),
    [
        (
            backends.MockSegmenter,
            lambda people, _: replace(people, masks=people.masks.transpose(0, 2, 1)),
            ["masks must be (1, 120, 160), got (1, 160, 120)"],
        ),
        (
            backends.MockBodyEstimator,
            nan_parameters,
            ["body_pose must be finite", "transl must be finite"],
        ),
    ],
)
def test_an_invalid_result_of_a_required_backend_stops_a_run(world, kind, change, faults):
    with pytest.raises(BackendOutputError) as error:
        run(world.image, backends=changed(kind, change))
    assert all(fault in str(error.value) for fault in faults)


@pytest.fixture(scope="module")
def without(few_steps, world):
    """A function that gives the result without the backend of an interface."""

    @cache
    def run_without(interface):
        return run(world.image, f"{interface}.backend=none")

    return run_without


HANDS = (
    backends.MockHandEstimator,
    "hands",
    "fingers keep the pose from the body_estimator",
)
CONTACT = (
    backends.MockContactPrior,
    "contact prior",
    "contact is computed from distances only",
)


def test_a_person_observer_that_fails_costs_a_warning_alone(world):
    result = run(world.image, backends=changed(backends.MockPersonObserver, nans("posture_share")))
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
        (
            CONTACT,
            lambda a, *_: replace(a, topology="smpl"),
            "topology must be 'physic-embedded-1'",
        ),
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
    kind, stage, consequence = optional
    result = run(world.image, backends=changed(kind, change))
    assert any(
        reason in warning and warning.endswith(f"; {consequence}") for warning in result.warnings
    )
    assert any(
        f"has no valid values from {kind.interface}" in warning for warning in result.warnings
    )
    assert result.people[0].failed_checks[0] == "placed"
    plain = without(kind.interface)
    np.testing.assert_array_equal(result.people[0].vertices, plain.people[0].vertices)
    np.testing.assert_array_equal(result.people[0].contact, plain.people[0].contact)
    assert [s.name for s in result.stages if s.failed] == [stage]
    result.save(str(tmp_path), "numbers")
    assert Reconstruction.load(str(tmp_path)).stages == result.stages


def test_ctrl_c_ends_an_optional_stage(world):
    with pytest.raises(KeyboardInterrupt):
        run(
            world.image,
            backends=changed(
                backends.MockHandEstimator, lambda *_: signal.raise_signal(signal.SIGINT)
            ),
        )
