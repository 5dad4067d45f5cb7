"""What ``benchmarks/kernels.py`` calls a difference between two kernel sets."""

from __future__ import annotations

import importlib.util
import platform
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "kernels.py"


@pytest.fixture(scope="module")
def kernels() -> ModuleType:
    spec = importlib.util.spec_from_file_location("kernels", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[spec.name]
    return module


@pytest.fixture
def answer(kernels):
    return kernels.Answer(
        joints=np.zeros((2, 55, 3)),
        floor=np.array([0.0, -1.0, 0.0, 1.5]),
        contact=np.zeros((2, 1000), bool),
        checks={("floor", None): True, ("legs_seen", 1): False},
    )


def test_small_differences_are_within_the_limits(kernels, answer):
    other = replace(
        answer, joints=answer.joints + np.array([0.004, 0.0, 0.0]), contact=np.arange(2000).reshape(2, 1000) < 10
    )
    found = kernels.difference(answer, other)
    assert (found.joint_mm, found.floor_deg, found.contact) == (pytest.approx(4), 0, pytest.approx(0.01))
    assert not found.large


def test_each_limit_is_held_for_the_worst_person(kernels, answer):
    joints, contact = answer.joints.copy(), answer.contact.copy()
    joints[1, 20] = [0, 0.006, 0]
    contact[1, :11] = True
    tilted = np.array([np.sin(np.radians(0.6)), -np.cos(np.radians(0.6)), 0.0, 1.5])
    found = [
        kernels.difference(answer, replace(answer, **other))
        for other in ({"joints": joints}, {"contact": contact}, {"floor": tilted})
    ]
    assert found[0].joint_mm == pytest.approx(6)
    assert found[1].contact == pytest.approx(0.011)
    assert found[2].floor_deg == pytest.approx(0.6)
    assert all(one.large for one in found)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"checks": {("floor", None): False, ("legs_seen", 1): False}}, "floor: True/False"),
        ({"checks": {("floor", None): True}}, "legs_seen of 1: False/None"),
        ({"joints": np.zeros((1, 55, 3))}, "2/1 people"),
        ({"error": "no person"}, "''/'no person'"),
    ],
)
def test_what_one_set_has_and_the_other_has_not_is_a_difference(kernels, answer, change, told):
    found = kernels.difference(answer, replace(answer, **change))
    assert found.flips == (told,)
    assert found.large


def test_a_floor_or_a_body_that_is_lost_is_infinitely_far(kernels, answer):
    lost = answer.joints.copy()
    lost[0] = np.nan
    assert kernels.difference(answer, replace(answer, floor=None)).floor_deg == np.inf
    assert kernels.difference(answer, replace(answer, joints=lost)).joint_mm == np.inf
    assert not kernels.difference(replace(answer, joints=lost), replace(answer, joints=lost)).large


def test_the_report_ends_with_one_where_something_is_beyond(kernels, answer, capsys):
    far = replace(answer, joints=answer.joints + 0.1)
    assert kernels.report(["a.jpg"], {"Haswell": [answer], "Nehalem": [answer]}) == 0
    assert kernels.report(["a.jpg"], {"Haswell": [answer], "Nehalem": [answer], "SkylakeX": [far]}) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "1 of 2 beyond 5 mm, 0.5 degrees, 1%"


def test_sets_that_compute_the_same_are_refused(kernels, monkeypatch, capsys):
    monkeypatch.setattr(kernels, "runs_here", lambda name: True)
    monkeypatch.setattr(kernels, "probe", {"Haswell": "a", "Nehalem": "b", "SkylakeX": "a"}.get)
    monkeypatch.setattr(kernels, "run_set", lambda name, task: pytest.fail("nothing is reconstructed"))
    monkeypatch.setattr(sys, "argv", ["kernels.py", "photo.jpg"])
    assert kernels.main() == 2
    assert "Haswell and SkylakeX compute bit for bit the same" in capsys.readouterr().out


def test_the_digest_is_of_the_arithmetic_alone(kernels):
    assert kernels.arithmetic_digest() == kernels.arithmetic_digest()
    assert kernels.same_arithmetic({"Haswell": "a", "Nehalem": "b"}) == ()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="the kernel sets are of x86")
def test_the_oldest_set_computes_otherwise_than_the_newer_one(kernels):
    if not kernels.runs_here("Haswell"):
        pytest.skip("the CPU has no AVX2")
    assert kernels.probe("Haswell") != kernels.probe("Nehalem")
