"""What the kit says about perfect networks whose wrapper is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from right_backends import SIZE

from physic_mock import backends as mocks
from physic_testing.conformance.backend_under_test import find_backend
from physic_testing.conformance.kit import start_checks
from physic_testing.conformance.report import Result


def is_exact(mock: type, change: Any, **settings: Any) -> Result:
    """Return the result of the check for a mock without noise whose output is changed."""

    class Changed(mock):  # type: ignore[misc, valid-type]
        def infer(self, image: Any, *rest: Any) -> Any:
            return change(super().infer(image, *rest), image)

    return start_checks(find_backend(Changed, None, size=SIZE, **settings)).result("is_exact")


def turned_back(answer: Any, image: Any) -> Any:
    is_portrait = image.shape[0] > image.shape[1]
    return replace(answer, depth=answer.depth[::-1, ::-1].copy()) if is_portrait else answer


def scaled_pose(answer: Any, image: Any) -> Any:
    return replace(
        answer, parameters=replace(answer.parameters, body_pose=0.9 * answer.parameters.body_pose)
    )


@pytest.mark.parametrize(
    ("mock", "change", "settings", "words"),
    [
        (
            mocks.MockMetricDepth,
            lambda a, _: replace(a, depth=a.depth**1.05),
            {},
            "the power 1.05 of the depth",
        ),
        (
            mocks.MockMetricDepth,
            lambda a, _: replace(a, depth=np.minimum(a.depth, 4.6)),
            {},
            "is it clipped at a limit",
        ),
        (mocks.MockMetricDepth, turned_back, {}, "turned for the network and back"),
        (mocks.MockBodyEstimator, scaled_pose, {}, "0.9 times the truth"),
    ],
    ids=["power", "saturated", "turned", "scale"],
)
def test_a_perfect_network_in_a_wrong_wrapper_is_explained(
    mock: type, change: Any, settings: Any, words: str
):
    result = is_exact(mock, change, **settings)
    assert result.outcome == "failed"
    assert words in f"{result.got} {result.hint}"


def test_a_backend_that_is_wrong_about_the_scale_alone_is_judged_by_its_mean():
    def wrong_scale(answer: Any, image: Any) -> Any:
        rng = np.random.default_rng(int(image.sum()))
        return replace(answer, depth=answer.depth * np.float32(rng.uniform(0.9, 1.1)))

    found = is_exact(mocks.MockMetricDepth, wrong_scale)
    assert found.outcome == "passed", found


def test_noise_makes_no_perfect_network():
    noisy = find_backend(mocks.MockMetricDepth, None, size=SIZE, options={"noise": 1})
    assert start_checks(noisy).result("is_exact").reason.count("'exact'")


def test_limits_of_a_declared_backend_are_its_own():
    def blurred(answer: Any, _: Any) -> Any:
        return replace(answer, depth=answer.depth * np.float32(1.008))

    declared: dict[str, Any] = {"capabilities": {"exact"}}
    assert is_exact(mocks.MockMetricDepth, blurred, **declared).outcome == "passed"
    closer = is_exact(mocks.MockMetricDepth, blurred, **declared, exact_limits={"abs-rel": 0.001})
    assert "abs-rel of at most 0.001" in closer.expected
