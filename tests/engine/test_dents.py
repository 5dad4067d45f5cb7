"""Surfaces that give way: how deep, by class, and how far inpainted points were moved."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core.engine.contact.dents import GIVE_M, dent_depths, largest_dents
from physic_core.engine.contact.distance import SurfaceDistances
from physic_core.engine.contact.scene_parts import SceneParts
from physic_core.pipeline.measures import moved_scene
from physic_core.pipeline.person_measures import deep_shares
from physic_core.types import SURFACE_NAMES


def test_only_named_classes_give_way():
    label = torch.arange(-1, len(SURFACE_NAMES))
    none = torch.zeros(len(label), dtype=torch.int64)
    near = SurfaceDistances(
        torch.zeros(1, len(label)), torch.full((1, len(label)), torch.inf), torch.arange(len(label))[None]
    )
    give = largest_dents(near, SceneParts(SURFACE_NAMES, label, none, none.bool()))[0]
    assert set(GIVE_M) < set(SURFACE_NAMES)
    assert give.tolist() == pytest.approx([0.0, *(GIVE_M.get(name, 0.0) for name in SURFACE_NAMES)])
    assert 0 < max(GIVE_M.values()) <= 0.1


def dent(height: float, give: float) -> float:
    """Depth of the dent of a vertex at a height over a level surface."""
    return float(dent_depths(torch.tensor([[height]]).double(), torch.tensor([[give]]).double()))


@given(st.floats(-0.14, 0.14), st.sampled_from([0.02, 0.08]))
def test_a_dent_is_as_deep_as_the_vertex_and_no_deeper_than_the_surface_allows(height: float, give: float):
    assert dent(height, give) == pytest.approx(min(max(-height, 0.0), give))


def test_a_far_surface_has_no_dent_and_a_hard_one_none_that_is_known():
    assert dent(math.inf, 0.1) == 0.0
    assert math.isnan(dent(-0.05, 0.0))


def test_moved_points_are_measured_at_a_persons_pixels():
    before = torch.ones(10, 10, 3)
    after = before.clone()
    after[:5, :, 2] += 0.2
    mask = torch.zeros(10, 10, dtype=torch.bool)
    mask[:8] = True
    assert moved_scene(after, before, mask) == pytest.approx(0.2)
    assert moved_scene(after, before, ~mask) is None


def test_only_depth_beyond_the_dent_counts_as_penetration():
    result: Any = SimpleNamespace(
        depth_inside=torch.tensor([[0.05, 0.05, 0.2, 0.02]]), surface_share=torch.tensor([[0.4, 0.3, 0.2, 0.1]])
    )
    give = torch.tensor([[0.08, 0.0, 0.08, 0.0]])
    [share] = deep_shares(result, give)
    assert share == pytest.approx(0.5)
    [hard] = deep_shares(result, torch.zeros(1, 4))
    assert hard == pytest.approx(0.9)
