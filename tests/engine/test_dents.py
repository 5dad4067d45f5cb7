"""Surfaces that give way: how deep, by class."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core.engine.contact.distances import (
    GIVE_M,
    SurfaceDistances,
    dent_depths,
    largest_dents,
)
from physic_core.engine.contact.parts import SceneParts
from physic_core.types import SURFACE_NAMES


def test_only_named_classes_give_way():
    label = torch.arange(-1, len(SURFACE_NAMES))
    none = torch.zeros(len(label), dtype=torch.int64)
    near = SurfaceDistances(
        torch.zeros(1, len(label)),
        torch.full((1, len(label)), torch.inf),
        torch.arange(len(label))[None],
        torch.zeros(1, len(label), 3),
    )
    give = largest_dents(near, SceneParts(SURFACE_NAMES, label, none, none.bool()))[0]
    assert set(GIVE_M) < set(SURFACE_NAMES)
    assert give.tolist() == pytest.approx([0.0, *(GIVE_M.get(name, 0.0) for name in SURFACE_NAMES)])
    assert 0 < max(GIVE_M.values()) <= 0.1


def dent(height, give):
    """Depth of the dent of a vertex at a height over a level surface."""
    return float(dent_depths(torch.tensor([[height]]).double(), torch.tensor([[give]]).double()))


@given(st.floats(-0.14, 0.14), st.sampled_from([0.02, 0.08]))
def test_a_dent_is_as_deep_as_the_vertex_and_no_deeper_than_the_surface_allows(height, give):
    assert dent(height, give) == pytest.approx(min(max(-height, 0.0), give))


def test_a_far_surface_has_no_dent_and_a_hard_one_none_that_is_known():
    assert dent(math.inf, 0.1) == 0.0
    assert math.isnan(dent(-0.05, 0.0))
