"""Settings that change what counts as evidence: whose mask, which keypoints, which contacts, how
each is weighed.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.geometry.robust import robust_loss
from physic_paper.released.reprojection import is_near_mask
from physic_paper.terms.reprojection import ReprojectionByAxisTerm

from .adjusted import term_of

JOINT, PAPER, RELEASE, PROX = (
    engine_preset(name).joint for name in ("default", "paper", "release", "prox")
)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 9))
def test_near_mask_equals_its_slow_reference(seed, reach):
    rng = np.random.default_rng(seed)
    mask = rng.random((17, 23)) < 0.02
    uv = rng.uniform(-30, 50, (12, 2))
    got = is_near_mask(torch.from_numpy(uv), torch.from_numpy(mask), reach)
    rows, columns = mask.nonzero()
    for (u, v), near in zip(uv.round(), got.tolist(), strict=True):
        assert near == bool(((abs(columns - u) <= reach) & (abs(rows - v) <= reach)).any())


def test_reprojection_of_prox_is_by_axis_in_pixels_of_a_full_hd_picture(standing):
    state = standing.state
    off = replace(state, keypoints=state.keypoints + torch.tensor([3.0, 4.0]))
    energy = JointEnergy(off, PROX)
    assert term_of(energy, ReprojectionByAxisTerm)
    robust = partial(robust_loss, "geman_mcclure", c=100.0)
    want = (
        sum(float(robust(torch.tensor(px * 1920 / 320) ** 2)) for px in (3.0, 4.0))
        * energy.sampling.keypoint_weights
    )
    assert energy()["reprojection"].item() == pytest.approx(float(want.sum()), rel=1e-3)
