from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from physic_core.errors import InputError
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


@pytest.mark.parametrize("method", EVERY)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000), centre=st.tuples(st.integers(0, 59), st.integers(0, 47)), radius=st.integers(1, 12))
def test_unmasked_pixels_never_change_and_the_input_stays(method, seed, centre, radius):
    image = np.random.default_rng(seed).integers(0, 256, (48, 60, 3), dtype=np.uint8)
    before, mask = image.copy(), disc((48, 60), centre, radius)
    filled = method().infer(image, mask)
    assert filled.shape == image.shape
    assert filled.dtype == np.uint8
    np.testing.assert_array_equal(filled[~mask], before[~mask])
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("method", EVERY)
def test_an_empty_mask_gives_the_same_picture_in_a_new_array(method):
    image = gradient()
    filled = method().infer(image, np.zeros(image.shape[:2], bool))
    np.testing.assert_array_equal(filled, image)
    assert not np.shares_memory(filled, image)


@pytest.mark.parametrize("method", EVERY)
def test_a_mask_over_everything_is_refused(method):
    with pytest.raises(InputError) as caught:
        method().infer(gradient(), np.ones((90, 120), bool))
    assert str(caught.value) == ("The mask covers the whole image: leave some pixels unmasked to fill the hole from.")


@pytest.mark.parametrize("method", EVERY)
def test_a_mask_of_another_size_or_dtype_is_refused(method):
    with pytest.raises(InputError) as caught:
        method().infer(gradient(), np.zeros((120, 90), np.uint8))
    assert str(caught.value) == (
        "The mask must be (90, 120) bool like the image, got (120, 90) uint8: resize it, or threshold it."
    )


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


@pytest.mark.parametrize("method", EVERY)
def test_the_answer_is_the_same_each_time(method):
    image, mask = planks(96, 128), disc((96, 128), (64, 48), 18)
    np.testing.assert_array_equal(method().infer(image, mask), method().infer(image, mask))


def test_patches_draw_by_seed():
    image, mask = planks(96, 128), disc((96, 128), (64, 48), 18)
    one, two = (PatchBased(PatchOptions(seed=seed, rounds=1)).infer(image, mask) for seed in (1, 2))
    assert (one != two).any()


def test_patches_work_reduced_with_the_hole_at_the_border():
    image = planks(191, 253)  # neither side divides by the reduction
    mask = np.zeros((191, 253), bool)
    mask[100:, 200:] = True
    filled = PatchBased(PatchOptions(working_px=600)).infer(image, mask)
    np.testing.assert_array_equal(filled[~mask], image[~mask])
    assert filled[mask].std() > 0.8 * image[mask].std()


def test_patches_need_one_square_without_mask():
    mask = np.ones((40, 40), bool)
    mask[:4] = False
    with pytest.raises(InputError) as caught:
        PatchBased().infer(gradient(40, 40), mask)
    assert str(caught.value) == "No 7 x 7 px square of the image is free of the mask: use a smaller patch_radius_px."


def test_reduce_means_known_pixels_only():
    image = np.array([[10, 20, 30], [30, 40, 50]], np.uint8)[..., None].repeat(3, axis=2)
    mask = np.array([[True, False, True], [False, False, True]])
    small, hole = downsample_known(image, mask, 2)
    np.testing.assert_array_equal(small[..., 0], [[30, 0]])  # (20 + 30 + 40) / 3; the last column is all hole
    np.testing.assert_array_equal(hole, [[False, True]])


def test_opencv_has_no_inpainting_of_its_own_by_patches():
    assert not hasattr(cv2, "xphoto")
