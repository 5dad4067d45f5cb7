"""``benchmarks/jumps.py``: differences that are put in by hand come out as these numbers."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

PATH = Path(__file__).parents[2] / "benchmarks" / "jumps.py"


@pytest.fixture(scope="module")
def jumps() -> ModuleType:
    spec = importlib.util.spec_from_file_location("jumps_benchmark", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def result(scene_offset_m: float = 0.0, vertex_offset_m: float = 0.0, people: int = 1) -> SimpleNamespace:
    points = np.zeros((4, 5, 3))
    points[..., 2] = 3 + scene_offset_m
    vertices, contact = np.zeros((10, 3)), np.zeros(10, bool)
    vertices[7, 0], contact[7] = vertex_offset_m, bool(vertex_offset_m)
    person = SimpleNamespace(vertices=vertices, contact=contact)
    return SimpleNamespace(scene=SimpleNamespace(points=points, valid=np.ones((4, 5), bool)), people=(person,) * people)


def test_every_copy_differs_in_one_value_by_one_level(jumps: ModuleType) -> None:
    for level in (0, 128, 255):
        image = np.full((6, 7, 3), level, np.uint8)
        for other in jumps.changed(image, 5, seed=1):
            difference = np.abs(other.astype(int) - image)
            assert difference.sum() == difference.max() == 1


def test_a_moved_scene_and_vertex_and_a_changed_label_are_measured(jumps: ModuleType) -> None:
    found = jumps.jump(result(), result(scene_offset_m=0.02, vertex_offset_m=0.03))
    assert (found.scene_mm, found.vertex_mm, found.labels) == pytest.approx((20, 30, 10))


def test_a_lost_person_is_infinitely_far_away(jumps: ModuleType) -> None:
    assert jumps.jump(result(), result(people=0)).vertex_mm == np.inf


def test_scenes_without_a_common_point_are_infinitely_far_apart(jumps: ModuleType) -> None:
    lost = result()
    lost.scene.valid[:] = False
    assert jumps.jump(result(), lost).scene_mm == np.inf
