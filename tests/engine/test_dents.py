"""Surfaces that give way: how deep, by class, and how far inpainted points were moved."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core.engine.contact.dents import GIVE_M, above_dents, dent_depths, give_of_points
from physic_core.engine.contact.scene_parts import SceneParts
from physic_core.pipeline.contacts import _share_below_dents
from physic_core.pipeline.measures import moved_scene
from physic_core.types import SURFACE_NAMES


def test_only_named_classes_give_way():
    label = torch.arange(-1, len(SURFACE_NAMES))
    none = torch.zeros(len(label), dtype=torch.int64)
    give = give_of_points(SceneParts(SURFACE_NAMES, label, none, none.bool()))
    assert set(GIVE_M) < set(SURFACE_NAMES)
    assert give.tolist() == [0.0, *(GIVE_M.get(name, 0.0) for name in SURFACE_NAMES)]
    assert 0 < max(GIVE_M.values()) <= 0.1


@given(st.floats(-0.15, 0.15), st.sampled_from([0.0, 0.02, 0.08]))
def test_a_dent_takes_up_what_its_surface_allows_and_the_rest_is_penetration(distance: float, give: float):
    signed, allowed = torch.tensor([distance], dtype=torch.float64), torch.tensor([give], dtype=torch.float64)
    dented, dent = float(above_dents(signed, allowed)), float(dent_depths(signed, allowed))
    assert dent == min(max(-distance, 0.0), give)
    assert dented == pytest.approx(distance + dent)


def test_a_far_surface_has_no_dent():
    far = torch.tensor([math.inf])
    assert dent_depths(far, torch.tensor([0.1])).tolist() == [0.0]
    assert above_dents(far, torch.tensor([0.1])).tolist() == [math.inf]


def test_moved_points_are_measured_at_a_persons_pixels():
    before = torch.ones(10, 10, 3)
    after = before.clone()
    after[:5, :, 2] += 0.2
    mask = torch.zeros(10, 10, dtype=torch.bool)
    mask[:8] = True
    assert moved_scene(after, before, mask) == pytest.approx(0.2)
    assert moved_scene(after, before, ~mask) is None


def test_only_what_is_deeper_than_a_dent_counts_as_penetration():
    result: Any = SimpleNamespace(
        depth_inside=torch.tensor([[0.05, 0.05, 0.2, 0.02]]), surface_share=torch.tensor([[0.4, 0.3, 0.2, 0.1]])
    )
    give = torch.tensor([[0.08, 0.0, 0.08, 0.0]])
    [share] = _share_below_dents(result, torch.tensor([0]), give)
    assert share == pytest.approx(0.5)
    [hard] = _share_below_dents(result, torch.tensor([0]), torch.zeros(1, 4))
    assert hard == pytest.approx(0.9)
