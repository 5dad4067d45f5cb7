"""What a hand holds is nothing that a body touches in the scene."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core.engine.scene.held import without_held_things

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("side", [0, 1])
def test_no_point_of_the_surroundings_is_held(standing, side):
    state = standing.state
    held = np.zeros((1, 2, *state.scene.valid.shape), bool)
    held[0, side, 100:140, 50:90] = True
    estimates = SimpleNamespace(photo=SimpleNamespace(held=torch.from_numpy(held)))
    thing = torch.from_numpy(held[0, side]) & state.scene.valid
    left = without_held_things(estimates, state).surroundings.points
    others = state.scene.points[state.scene.valid & ~thing]
    assert thing.any()
    assert torch.equal(left, others.to(left))
