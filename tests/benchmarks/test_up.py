"""The fit of up to crops of panoramas: where a crop looks, and the regression on made-up tokens."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.observer.regression import Examples, logits_of
from benchmarks.up import View, crop_of, fit_angles, scores

HORIZON = np.zeros((256, 512, 3), np.uint8)
HORIZON[:128] = 255


@pytest.mark.parametrize("pitch", [-20.0, 0.0, 15.0])
@pytest.mark.parametrize("roll", [-10.0, 0.0, 25.0])
def test_the_horizon_of_a_crop_lies_where_pitch_and_roll_put_it(pitch, roll):
    size = (480, 360)
    crop = crop_of(HORIZON, View(size, 80.0, pitch, roll, 1.0))
    focal = 240 / np.tan(np.radians(40))
    x, y = np.meshgrid(np.arange(480) - 239.5, np.arange(360) - 179.5)
    p, r = np.radians([pitch, roll])
    up = np.array([np.cos(p) * np.sin(r), -np.cos(p) * np.cos(r), -np.sin(p)])
    above = x * up[0] + y * up[1] + focal * up[2] > 0
    assert ((crop[..., 0] > 127) == above).mean() > 0.99


def test_the_fit_finds_pitch_and_roll_and_the_mirrored_roll():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 3, 3, 4))
    rows, sides = np.arange(3) - 1, np.arange(3) - 1
    y = np.stack([x[..., 0].mean(2) @ rows, x[..., 1].mean(1) @ sides], axis=1) * [40, 20]
    of = Examples(x.reshape(300, -1), y, np.ones(300), [str(i // 10) for i in range(300)])
    numbers = fit_angles(of)
    said = logits_of(numbers, of.x)
    assert np.corrcoef(said[:, 0], y[:, 0])[0, 1] > 0.95
    mirrored = logits_of(numbers, x[:, :, ::-1].reshape(300, -1))
    np.testing.assert_allclose(mirrored, said * [1, -1], atol=1e-9)
    assert len(scores(of)) == 2
