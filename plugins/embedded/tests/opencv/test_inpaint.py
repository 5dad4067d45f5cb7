from __future__ import annotations

import numpy as np

from physic_opencv.inpaint import Telea, TeleaOptions


def gradient(height=90, width=120):
    """A slope of 120 grey levels along x, 90 along y."""
    v, u = np.mgrid[:height, :width]
    u = 120 * u / width
    v = 90 * v / height
    return np.stack([u + v, 200 - u, 60 + v], axis=2).astype(np.uint8)


def disc(shape, centre, radius):
    v, u = np.mgrid[: shape[0], : shape[1]]
    return (u - centre[0]) ** 2 + (v - centre[1]) ** 2 <= radius**2


def test_a_slope_is_restored():
    image = gradient()
    mask = disc((90, 120), (60, 45), 12)
    wrong = image.copy()
    wrong[mask] = 0
    filled = Telea().infer(wrong, mask)
    error = np.abs(filled[mask].astype(int) - image[mask]).mean()
    assert error < 4


def test_what_was_under_the_mask_never_leaks_out_even_from_a_reduced_image():
    image = gradient(240, 320)
    mask = disc((240, 320), (160, 120), 61)
    options = TeleaOptions(max_hole_px=40)
    black = image.copy()
    white = image.copy()
    black[mask] = 0
    white[mask] = 255
    filled = Telea(options).infer(black, mask)
    np.testing.assert_array_equal(filled[mask], Telea(options).infer(white, mask)[mask])
    error = np.abs(filled[mask].astype(int) - image[mask]).mean()
    assert error < 12
