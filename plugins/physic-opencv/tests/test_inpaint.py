from __future__ import annotations

import numpy as np
import pytest

from physic_opencv.inpaint import DiffusionOptions, NavierStokes, Telea, downsample_known
from physic_opencv.patches import PatchBased, PatchOptions

EVERY = [Telea, NavierStokes, PatchBased]


def gradient(height: int = 90, width: int = 120) -> np.ndarray:
    """A slope of 120 grey levels along x, 90 along y."""
    v, u = np.mgrid[:height, :width]
    u, v = 120 * u / width, 90 * v / height
    return np.stack([u + v, 200 - u, 60 + v], axis=2).astype(np.uint8)


def disc(shape: tuple[int, int], centre: tuple[int, int], radius: int) -> np.ndarray:
    v, u = np.mgrid[: shape[0], : shape[1]]
    return (u - centre[0]) ** 2 + (v - centre[1]) ** 2 <= radius**2


def planks(height: int, width: int) -> np.ndarray:
    """A floor of planks with grain: vertical stripes with dark joints and noise."""
    rng = np.random.default_rng(3)
    u = np.arange(width)
    tone = 120 + 30 * ((u // 16) % 2) - 70 * (u % 16 == 0)
    image = np.repeat(np.broadcast_to(tone, (height, width))[..., None], 3, axis=2) * [1.0, 0.8, 0.6]
    return np.clip(image + rng.normal(0, 8, (height, width, 1)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("method", "allowed"),
    [(Telea, 4.0), (NavierStokes, 4.0), (PatchBased, 8.0)],
    ids=lambda x: getattr(x, "__name__", x),
)
def test_a_slope_is_restored(method, allowed):
    image = gradient()
    mask = disc((90, 120), (60, 45), 12)
    wrong = image.copy()
    wrong[mask] = 0
    filled = method().infer(wrong, mask)
    error = np.abs(filled[mask].astype(int) - image[mask]).mean()
    print(f"{method.__name__}: mean error {error:.2f} grey levels")
    assert error < allowed


@pytest.mark.parametrize("method", [Telea, NavierStokes])
def test_what_was_under_the_mask_never_leaks_out_even_from_a_reduced_image(method):
    image, mask = gradient(240, 320), disc((240, 320), (160, 120), 61)
    options = DiffusionOptions(max_hole_px=40)
    black, white = image.copy(), image.copy()
    black[mask], white[mask] = 0, 255
    filled = method(options).infer(black, mask)
    np.testing.assert_array_equal(filled[mask], method(options).infer(white, mask)[mask])
    error = np.abs(filled[mask].astype(int) - image[mask]).mean()
    print(f"{method.__name__}: mean error {error:.2f} grey levels")
    assert error < 12


def test_what_was_under_the_mask_never_leaks_into_patches():
    image, mask = planks(96, 128), disc((96, 128), (64, 48), 15)
    black, white = image.copy(), image.copy()
    black[mask], white[mask] = 0, 255
    np.testing.assert_array_equal(PatchBased().infer(black, mask)[mask], PatchBased().infer(white, mask)[mask])


def test_patches_keep_the_planks_that_diffusion_smears():
    image = planks(180, 240)
    mask = disc((180, 240), (120, 90), 30)
    error, sharpness = {}, {}
    for method in EVERY:
        filled = method().infer(image, mask)
        inner = disc((180, 240), (120, 90), 24)
        error[method] = np.abs(filled[inner].astype(float) - image[inner]).mean()
        step = [np.abs(np.diff(x.astype(float), axis=1, prepend=0))[inner].mean() for x in (filled, image)]
        sharpness[method] = step[0] / step[1]
        print(f"{method.__name__}: mean error {error[method]:.1f}, sharpness {sharpness[method]:.2f} of the truth")
    assert error[PatchBased] < 0.6 * error[Telea]
    assert sharpness[PatchBased] > 0.8
    assert sharpness[Telea] < 0.7


def test_patches_work_reduced_with_the_hole_at_the_border():
    image = planks(191, 253)  # neither side divides by the reduction
    mask = np.zeros((191, 253), bool)
    mask[100:, 200:] = True
    filled = PatchBased(PatchOptions(working_px=600)).infer(image, mask)
    np.testing.assert_array_equal(filled[~mask], image[~mask])
    assert filled[mask].std() > 0.8 * image[mask].std()


def test_reduce_means_known_pixels_only():
    image = np.array([[10, 20, 30], [30, 40, 50]], np.uint8)[..., None].repeat(3, axis=2)
    mask = np.array([[True, False, True], [False, False, True]])
    small, hole = downsample_known(image, mask, 2)
    np.testing.assert_array_equal(small[..., 0], [[30, 0]])  # (20 + 30 + 40) / 3; the last column is all hole
    np.testing.assert_array_equal(hole, [[False, True]])
