"""People as a ruler: stature against the scene's scale, as two measurements are weighed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize
from physic_core.engine.sizes.stature import STATURE_SIGMA, linearise_stature, size_sigmas

from .adjusted import adjusted, larger_scene
from .drawn import normal

JOINT = engine_preset("default").joint


def test_stature_is_linear_in_shape(body):
    betas = torch.zeros(1, body.num_betas)
    stature = linearise_stature(body, betas)
    for seed in range(5):
        other = 0.7 * normal(1, body.num_betas, seed=seed).float()
        assert stature(other).item() == pytest.approx(body.stature(other).item(), abs=3e-3)


def test_the_size_of_people_of_unknown_age_includes_children():
    nan = np.nan
    stature = np.array([nan, nan, nan, 1.7])
    years = np.array([nan, 40.0, 8.0, nan])
    unknown, adult, child, measured = size_sigmas(stature, years, np.full(4, nan))
    assert 0.1 < unknown < 0.13
    assert adult == pytest.approx(STATURE_SIGMA)
    assert 0.04 < child < adult
    assert measured < 0.01
    said = np.array([0.01, 0.4, 0.6, 0.97])
    surely_adult, hardly, perhaps, surely_child = size_sigmas(*np.full((2, 4), nan), said)
    assert surely_adult < unknown < hardly
    assert surely_adult < surely_child < perhaps


def test_a_scene_of_known_size_gives_the_size_of_people_of_unknown_age():
    nan = np.array([np.nan])
    assert size_sigmas(nan, nan, nan, 0.01) == pytest.approx(math.hypot(0.01, 0.05))
    assert size_sigmas(nan, nan, nan, 0.5) == size_sigmas(nan, nan, nan)


def spread_of_stature(body):
    """Standard deviation of log(stature) that the shape prior of weight 1 stands for: the whitened
    shape is normal.
    """
    betas = torch.zeros(1, body.num_betas)
    stature = linearise_stature(body, betas)
    return 0.5 * (stature.slope / stature.height[:, None]).norm().item()


def test_the_shape_prior_alone_knows_stature_to_five_percent(body):
    assert spread_of_stature(body) == pytest.approx(0.054, abs=0.003)


@pytest.mark.parametrize(("scale_sigma", "stature_weight"), [(0.05, 1.0), (0.1, 0.0)])
def test_scene_and_stature_share_a_disagreement_as_two_measurements_do(
    standing, body, scale_sigma, stature_weight
):
    """A scene 8 % too large for its person: floor and picture say only that one of them is
    wrong.
    """
    too_large = 1.08
    state = standing.state
    large = replace(larger_scene(state, too_large), scale_sigma=scale_sigma)
    # Pose and place have next to no say in it: only how large the person is, and how large the
    # scene.
    settings = adjusted(
        JOINT,
        frozen=("pose", "hands", "root"),
        optimiser__tolerance=0.0,
        optimiser__steps=60,
        depth__offset_sigma=0.0,
        regularisation__translation_weight=0.0,
        regularisation__sigma_m=10.0,
        stature__weight=stature_weight,
        scene_scale__weight=1.0,
    )
    result = optimize(large, settings)
    precision = 1 / spread_of_stature(body) ** 2 + stature_weight / STATURE_SIGMA**2
    expected = -math.log(too_large) * scale_sigma**2 / (scale_sigma**2 + 1 / precision)
    grown = math.log(float(body.stature(result.betas)) / float(body.stature(state.betas)))
    assert math.log(result.unapplied_scene_scale) == pytest.approx(expected, abs=0.01)
    assert grown == pytest.approx(expected + math.log(too_large), abs=0.01)
