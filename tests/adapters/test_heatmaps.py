"""Peaks of heat maps: known Gaussians, a slow twin, and the decoders of transformers and of SimCC."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from physic_core.adapters.heatmaps import heatmap_peaks, subpixel_peaks

if TYPE_CHECKING:
    from numpy.typing import NDArray


def gaussians(points: NDArray[np.float64], height: int, width: int, sigma: float, high: float = 0.9) -> NDArray:
    """(N, J, h, w): a Gaussian at each of the points (N, J, 2)."""
    y, x = np.mgrid[:height, :width]
    apart = (x - points[..., 0, None, None]) ** 2 + (y - points[..., 1, None, None]) ** 2
    return high * np.exp(-apart / (2 * sigma**2))


@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.0])
def test_known_peaks_are_found_to_a_twentieth_of_a_cell(sigma: float) -> None:
    true = np.random.default_rng(0).uniform([6, 6], [41, 57], (3, 40, 2))
    found, value = subpixel_peaks(gaussians(true, 64, 48, sigma))
    apart = np.linalg.norm(found - true, axis=-1)
    coarse = np.linalg.norm(heatmap_peaks(gaussians(true, 64, 48, sigma))[0] - true, axis=-1)
    assert apart.max() < 0.05 < coarse.max()
    assert (value > 0.8).all()
    assert (value <= 0.9).all()


def test_peaks_within_noise_stay_within_half_a_cell() -> None:
    rng = np.random.default_rng(1)
    true = rng.uniform([6, 6], [41, 57], (1, 60, 2))
    maps = gaussians(true, 64, 48, 2.0) + rng.normal(0, 0.02, (1, 60, 64, 48))
    found, _ = subpixel_peaks(maps)
    assert np.linalg.norm(found - true, axis=-1).max() < 0.5


def test_refined_peaks_are_those_of_transformers() -> None:
    pytest.importorskip("transformers")
    from transformers.models.vitpose.image_processing_pil_vitpose import (
        get_keypoint_predictions,
        post_dark_unbiased_data_processing,
    )

    true = np.random.default_rng(3).uniform([1, 1], [46, 62], (2, 17, 2))
    maps = gaussians(true, 64, 48, 2.0).astype(np.float32)
    cells, scores = get_keypoint_predictions(maps)
    theirs = post_dark_unbiased_data_processing(cells.copy(), maps, kernel=11)
    ours, value = subpixel_peaks(maps)
    assert np.allclose(ours, theirs, atol=2e-3)
    assert np.allclose(value, scores[..., 0])
