"""A new interface is one class: stages and conformance kit read its contract there."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
import pytest
from stand_ins import SIZE

from physic_core.configuration.resolve import ResolvedBackend
from physic_core.errors import BackendOutputError
from physic_core.interfaces import INTERFACES, Backend, Request
from physic_core.interfaces.checks import check_array, check_finite
from physic_core.pipeline.stage_caller import StageCaller
from physic_core.types import Hints, Provenance
from physic_testing import check_backend, violations


@dataclass(frozen=True)
class Normals:
    """Unit normals (H, W, 3)."""

    normals: np.ndarray


@dataclass(frozen=True)
class NormalsRequest(Request[Normals]):
    hints: Hints


class NormalEstimator(Backend):
    """Estimates surface normals."""

    interface = "normal_estimator"
    api = 1
    Request = NormalsRequest
    Result = Normals
    sees = "inpainted"
    hints = ("intrinsics", "people")

    @abstractmethod
    def infer(self, image, hints):
        """Image (H, W, 3) -> normals."""

    @classmethod
    def check(cls, result, request):
        wrong = list(check_array("normals", result.normals, request.image.shape, "float"))
        yield from wrong or check_finite("normals", result.normals)


class Flat(NormalEstimator):
    def infer(self, image, hints):
        return Normals(np.zeros(image.shape, np.float32))


class Turned(Flat):
    def infer(self, image, hints):
        return super().infer(image.transpose(1, 0, 2), hints)


@pytest.fixture(autouse=True)
def tenth(monkeypatch):
    monkeypatch.setitem(INTERFACES, NormalEstimator.interface, NormalEstimator)


def test_stages_check_its_results():
    request = NormalsRequest(np.zeros((6, 8, 3), np.uint8), Hints())

    def call(backend):
        who = Provenance("normal_estimator", "mine", "my_plugin", "my-dist", "1.0", {}, "")
        return StageCaller("cpu", 1).call_backend("normals", ResolvedBackend(backend, who), request)

    assert call(Flat()).normals.shape == (6, 8, 3)
    with pytest.raises(BackendOutputError, match=r"normals must be \(6, 8, 3\), got \(8, 6, 3\)$"):
        call(Turned())


def test_the_kit_calls_it_and_checks_its_results():
    assert check_backend(Flat, size=SIZE).ok
    report = check_backend(Turned, size=SIZE)
    form = {failure.check: failure for failure in report.failures}["returns_valid_output"]
    assert "normals must be (120, 160, 3), got (160, 120, 3)" in form.got


def test_unit_tests_can_check_a_result_without_a_backend():
    assert violations(NormalEstimator, Normals(np.zeros((6, 8, 3))), height=6, width=8) == []
    assert violations(NormalEstimator, None) == ["expected Normals, got NoneType"]
