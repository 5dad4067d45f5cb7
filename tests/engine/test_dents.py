"""Surfaces that give way: how deep, by class."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core.engine.contact.distances import GIVE_M, SurfaceDistances, dent_depths
from physic_core.engine.contact.parts import SceneParts
from physic_core.types import SURFACE_NAMES


@given(st.one_of(st.floats(-0.14, 0.14), st.just(math.inf)))
def test_a_dent_is_as_deep_as_the_vertex_and_no_deeper_than_the_class_of_its_surface_allows(height):
    label = torch.arange(-1, len(SURFACE_NAMES))
    distance = torch.full((1, len(label)), height, dtype=torch.float64)
    none = torch.zeros(len(label), dtype=torch.int64)
    far = torch.full_like(distance, torch.inf)
    near = SurfaceDistances(distance, far, torch.arange(len(label))[None], torch.zeros(1, 1, 3))
    dents = dent_depths(near, SceneParts(SURFACE_NAMES, label, none, none.bool()))[0].tolist()
    for name, dent in zip(("", *SURFACE_NAMES), dents, strict=True):
        if name in GIVE_M and height < math.inf:
            assert dent == pytest.approx(min(max(-height, 0.0), GIVE_M[name]))
        else:
            assert math.isnan(dent)
