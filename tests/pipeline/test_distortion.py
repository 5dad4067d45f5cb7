"""Lens distortion: the picture is undistorted once, and pixels map to the file and back."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from physic_core import (
    ConfigError,
    Intrinsics,
    KnownLength,
    KnownSizes,
    PeoplePrompt,
)
from physic_core.configuration.model import PhotoSettings
from physic_core.geometry.camera import check_distortion, undistort_image, undistort_pixels
from physic_core.io.photo import Photo
from physic_core.prepare.photo import prepare_photo
from physic_core.types import Lens
from physic_testing.worlds import load_world
from tests.pipeline.mocks import run

CAMERA = Intrinsics(300.0, 310.0, 155.0, 118.0, 320, 240)  # the principal point is off the centre
BARREL = (-0.28, 0.09, 0.0012, -0.0007, 0.004)
PINCUSHION = (0.12, -0.03, -0.001, 0.0015, 0.0)


def picture():
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    return np.ascontiguousarray(cv2.GaussianBlur(noise, (0, 0), 3))


@pytest.mark.parametrize("distortion", [BARREL, PINCUSHION])
def test_the_picture_is_that_of_opencv(distortion):
    own = undistort_image(picture(), CAMERA, distortion).astype(int)
    maps = cv2.initUndistortRectifyMap(
        CAMERA.matrix, np.array(distortion), None, CAMERA.matrix, (320, 240), cv2.CV_32F
    )
    theirs = cv2.remap(picture(), maps[0], maps[1], cv2.INTER_LINEAR).astype(int)
    # OpenCV interpolates at steps of 1/32 px.
    inside = (maps[0] > 0) & (maps[0] < 319) & (maps[1] > 0) & (maps[1] < 239)
    assert inside.mean() > 0.85
    assert np.abs(own - theirs)[inside].max() <= 3
    assert np.abs(own - theirs)[inside].mean() < 0.5


@pytest.mark.parametrize("distortion", [BARREL, PINCUSHION])
def test_pixels_are_those_of_opencv_and_map_back(
    distortion,
):
    rng = np.random.default_rng(1)
    seen = rng.uniform([0, 0], [320, 240], (50, 2))
    own = undistort_pixels(seen, CAMERA, distortion)
    rays = np.concatenate([own, np.ones((50, 1))], 1) @ np.linalg.inv(CAMERA.matrix).T
    theirs, _ = cv2.projectPoints(
        rays, np.zeros(3), np.zeros(3), CAMERA.matrix, np.array(distortion)
    )
    np.testing.assert_allclose(theirs[:, 0], seen, atol=1e-3)
    np.testing.assert_allclose(Lens(CAMERA, distortion).file_pixels(own, CAMERA), seen, atol=1e-3)


def test_prompts_and_lengths_move_with_the_picture():
    mask = np.zeros((1, 240, 320), bool)
    mask[0, 20:60, 30:70] = True
    prompt = PeoplePrompt(((30.0, 20.0),), ((30.0, 20.0, 70.0, 60.0),), mask)
    known = KnownSizes(lengths=(KnownLength((30.0, 20.0), (300.0, 220.0), 1.0),))
    given = PhotoSettings(intrinsics=(300, 310, 155, 118), distortion=BARREL)
    found = prepare_photo(Photo(picture()), given, prompt, known)
    moved = found.people
    corner = undistort_pixels(np.array([[30.0, 20.0]]), CAMERA, BARREL)[0]
    assert corner[0] < 25  # away from the centre: the lens has drawn it inwards
    assert moved.points[0] == pytest.approx(tuple(corner))
    assert found.known.lengths[0].start == pytest.approx(tuple(corner))
    rows, columns = moved.masks[0].nonzero()
    extent = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    assert moved.boxes[0] == pytest.approx(extent, abs=1.5)
    assert found.photo.notes[-1].startswith("the image was undistorted")
    assert found.photo.intrinsics == found.lens.intrinsics == replace(CAMERA, trust="known")
    given = PhotoSettings(intrinsics=(600, 620, 310.5, 236.5), distortion=BARREL)
    reduced = prepare_photo(Photo(picture(), file_size=(640, 480)), given, None, None)
    assert reduced.photo.intrinsics == found.photo.intrinsics
    assert reduced.lens.intrinsics == found.lens.intrinsics.resized(640, 480)


def test_a_distortion_that_folds_the_picture_is_refused():
    with pytest.raises(
        ConfigError, match=r"^the distortion -2, 0, 0, 0, 0 folds the picture onto itself near its"
    ):
        check_distortion(CAMERA, (-2.0, 0, 0, 0, 0))
    check_distortion(CAMERA, BARREL)


def test_a_result_states_the_lens_and_keeps_it(tmp_path):
    world = load_world("stand", (160, 120))
    K = [world.intrinsics.fx, world.intrinsics.fy, world.intrinsics.cx, world.intrinsics.cy]
    lens = f"photo.intrinsics={K}", "photo.distortion=[1e-9, 0, 0, 0, 0]"
    result = run(world.image, "engine.joint.optimiser.steps=2", *lens)
    assert result.lens.distortion == (1e-9, 0, 0, 0, 0)
    assert result.lens.intrinsics.fx == pytest.approx(world.intrinsics.fx)
    result.save(str(tmp_path / "out"), "numbers")
    assert result.load(str(tmp_path / "out")).lens == result.lens
