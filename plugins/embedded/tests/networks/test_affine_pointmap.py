"""Focal length and shift of affine point maps: known answers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from physic_core.errors import BackendError
from physic_core.types import Intrinsics
from physic_networks.affine_pointmap import (
    AffineCamera,
    half_diagonal,
    points_on_rays,
    recover_camera,
)


def depth_of_a_scene(height, width, seed=0, relief=1.0):
    """A floor, a wall and some bumps: depth from 1 to about 1 + 4 relief."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0 : 1 : height * 1j, 0 : 1 : width * 1j]
    waves = sum(
        np.sin(rng.uniform(1, 9) * u + rng.uniform(1, 9) * v + rng.uniform(0, 6)) for _ in range(4)
    )
    return 1 + relief * (waves + 4) / 4 + relief * (u > rng.uniform(0.3, 0.7))


def seen_by(focal, depth):
    """(H, W, 3) points of a depth, seen by a pinhole camera of this focal length, px; the middle is
    its centre.
    """
    height, width = depth.shape
    v, u = np.mgrid[:height, :width]
    return np.stack(
        [(u - (width - 1) / 2) / focal * depth, (v - (height - 1) / 2) / focal * depth, depth], -1
    )


def affine(points, scale, shift):
    """What a network answers, so that ``shift`` in its own units brings it back."""
    return points / scale - np.array([0, 0, shift])


sizes = st.integers(40, 200)


class TestExact:
    @settings(max_examples=25)
    @given(
        height=sizes,
        width=sizes,
        focal=st.floats(0.3, 20),
        shift=st.floats(-3, 3),
        scale=st.floats(0.05, 20),
        share=st.floats(0.1, 1),
        seed=st.integers(0, 10**6),
    )
    def test_focal_length_and_shift_are_recovered(
        self, height, width, focal, shift, scale, share, seed
    ):
        focal *= half_diagonal(height, width)
        points = affine(seen_by(focal, depth_of_a_scene(height, width, seed)), scale, shift)
        mask = np.random.default_rng(seed).random((height, width)) < share
        points[~mask] = [7, -3, 0.01]
        found = recover_camera(points, mask)
        assert found.determined
        assert found.fx == found.fy == pytest.approx(focal, rel=1e-6)
        assert found.shift == pytest.approx(shift, abs=1e-6 * max(1, 1 / scale))
        known = recover_camera(points, mask, focal)
        assert known.fx == known.fy == focal
        assert known.shift == pytest.approx(shift, abs=1e-6 * max(1, 1 / scale))

    def test_focal_lengths_that_differ_by_axis(self):
        """Pixels that are not square, as those of a photo that was resized."""
        depth = depth_of_a_scene(90, 120)
        points = seen_by(100.0, depth) * [100 / 80, 1, 1] - [0, 0, 0.4]
        found = recover_camera(points, np.ones((90, 120), bool), (80.0, 100.0))
        assert found.shift == pytest.approx(0.4, rel=1e-9)
        assert (found.fx, found.fy) == (80, 100)


class TestDoubtful:
    def test_same_optimum_as_a_general_solver(self):
        """Against Levenberg-Marquardt on both unknowns, on a map that no pinhole camera fits
        exactly.
        """
        rng = np.random.default_rng(1)
        depth = depth_of_a_scene(64, 64)
        points = affine(seen_by(60.0, depth), 1.0, 0.5) + 0.02 * rng.standard_normal((64, 64, 3))
        found = recover_camera(points, np.ones((64, 64), bool))
        v, u = np.mgrid[:64, :64] - 31.5
        uv = np.stack([u, v], -1)

        def left(unknown):
            focal, shift = unknown
            return (focal * points[..., :2] / (points[..., 2:] + shift) - uv).ravel()

        best = least_squares(left, (50.0, 0.6), method="lm", xtol=1e-15, ftol=1e-15).x
        assert (found.fx, found.shift) == pytest.approx(tuple(best), rel=1e-6)

    def test_noise_on_a_flat_wall_tells_nothing(self):
        rng = np.random.default_rng(0)
        points = seen_by(180.0, np.full((150, 200), 2.0)) + 0.01 * rng.standard_normal(
            (150, 200, 3)
        )
        found = recover_camera(points, np.ones((150, 200), bool))
        assert not found.determined
        assert found.fx == pytest.approx(180, rel=0.02)  # that of the shift 0
        assert found.shift == 0

    def test_known_focal_length_finds_the_shift_of_a_flat_wall(self):
        points = affine(seen_by(180.0, np.full((150, 200), 2.0)), 1.0, 0.7)
        found = recover_camera(points, np.ones((150, 200), bool), 180.0)
        assert found.determined
        assert found.shift == pytest.approx(0.7, rel=1e-9)


class TestRefused:
    """Never a focal length that nothing tells."""

    def test_mirrored_points_are_refused(self):
        points = seen_by(100.0, depth_of_a_scene(60, 80)) * [-1, -1, 1]
        with pytest.raises(
            BackendError, match="no focal length fits the point map: its points do not lie like"
        ):
            recover_camera(points, np.ones((60, 80), bool))

    @pytest.mark.parametrize("focal", [-5.0, np.nan])
    def test_a_known_focal_length_that_is_not_positive_is_an_error(self, focal):
        with pytest.raises(BackendError, match="must be a number of px above 0"):
            recover_camera(seen_by(100.0, depth_of_a_scene(60, 80)), np.ones((60, 80), bool), focal)


class TestSettle:
    def test_points_are_on_their_rays_in_metres(self):
        depth = depth_of_a_scene(60, 80)
        points = affine(seen_by(100.0, depth), 2.5, 0.3)
        found = recover_camera(points, np.ones((60, 80), bool))
        camera = found.intrinsics(80, 60, "given")
        settled, valid = points_on_rays(points[..., 2], np.ones((60, 80), bool), found, camera, 2.5)
        assert valid.all()
        assert settled.dtype == np.float32
        np.testing.assert_allclose(settled, seen_by(100.0, depth), rtol=1e-5, atol=1e-6)

    def test_what_does_not_count_is_nan(self):
        z = np.array([[1.0, np.nan, np.inf, -2.0, 1.0]])
        mask = np.array([[True, True, True, True, False]])
        settled, valid = points_on_rays(
            z, mask, AffineCamera(10, 10, 0.5), Intrinsics.from_focal(10, 5, 1)
        )
        np.testing.assert_array_equal(valid, [[True, False, False, False, False]])
        assert np.isnan(settled[~valid]).all()
        np.testing.assert_allclose(settled[0, 0], [-0.3, 0, 1.5], rtol=1e-6)
