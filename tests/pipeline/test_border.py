"""Borders of one colour: the picture inside is reconstructed, and the result is in px of the whole
photo.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physic_core import reconstruct
from physic_core.configuration.model import PhotoSettings
from physic_core.io.photo import Photo
from physic_core.prepare.border import find_border
from physic_core.prepare.photo import prepare_photo
from physic_core.types import Intrinsics, KnownLength, KnownSizes, PeoplePrompt
from physic_testing.worlds import load_world
from tests.pipeline.pictures import as_jpeg, textured

# top, bottom, left, right as shares of the photo's sides, and the colour.
BORDERS = {
    "bars of a screenshot": (0.4, 0.35, 0, 0, 0),
    "a strip at one side": (0, 0, 0, 0.6, 255),
    "a frame of 10 %": (0.1, 0.1, 0.1, 0.1, 255),
    "a frame of 2 px": (2 / 240, 2 / 240, 2 / 320, 2 / 320, 0),
}


def with_border(image, name):
    *shares, colour = BORDERS[name]
    height, width = image.shape[:2]
    top, bottom, left, right = (
        round(share * side)
        for share, side in zip(shares, (height, height, width, width), strict=True)
    )
    whole = np.full((height + top + bottom, width + left + right, 3), colour, np.uint8)
    inside = slice(top, top + height), slice(left, left + width)
    whole[inside] = image
    return whole, inside


@pytest.mark.parametrize("name", BORDERS)
def test_a_border_is_found_also_in_a_jpeg(name):
    whole, inside = with_border(textured(240, 320), name)
    assert find_border(whole) == inside
    found = find_border(as_jpeg(whole))
    for part, true in zip(found, inside, strict=True):
        assert (part.start, part.stop) == pytest.approx((true.start, true.stop), abs=1)


def test_a_frame_of_one_pixel_is_cut_and_a_line_at_one_side_is_not():
    photo = textured(240, 320)
    framed = np.pad(photo, ((1, 1), (1, 1), (0, 0)))
    assert find_border(framed) == (slice(1, 241), slice(1, 321))
    assert find_border(framed[:, :-1]) is None


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("ground", [0, 255])
def test_a_person_on_plain_ground_is_not_cut(ground, seed):
    rng = np.random.default_rng(seed)
    person = np.zeros((480, 360), np.uint8)
    shoulders = rng.integers(60, 150)
    top = int(rng.integers(60, 140))
    cv2.ellipse(person, (180, top + 40), (int(rng.integers(25, 60)), 45), 0, 0, 360, 255, -1)
    cv2.rectangle(person, (180 - shoulders, top + 90), (180 + shoulders, 480), 255, -1)
    share = cv2.GaussianBlur(person, (0, 0), 2)[..., None] / 255
    photo = (share * textured(480, 360, seed) + (1 - share) * ground).astype(np.uint8)
    assert find_border(photo) is None
    assert find_border(as_jpeg(photo)) is None


def test_a_sky_over_a_straight_horizon_is_not_cut():
    photo = textured(240, 320)
    photo[:60] = 225 + np.random.default_rng(0).integers(-12, 13, (60, 320, 1))
    assert find_border(photo) is None


def test_the_users_pixels_are_those_of_the_whole_photo():
    whole, (rows, columns) = with_border(textured(240, 320), "a frame of 10 %")
    y = rows.start
    x = columns.start
    mask = np.zeros((1, *whole.shape[:2]), bool)
    mask[0, y + 50 : y + 90, x + 20 : x + 40] = True
    given = PeoplePrompt(((x + 30.0, y + 60.0),), ((x + 5.0, y + 5.0, x + 95.0, y + 105.0),), mask)
    known = KnownSizes(lengths=(KnownLength((x + 1.0, y + 2.0), (x + 11.0, y + 2.0), 0.5),))
    prepared = prepare_photo(Photo(whole), PhotoSettings(focal_px=400), given, known)
    assert prepared.people.points == ((30.0, 60.0),)
    assert prepared.people.boxes == ((5.0, 5.0, 95.0, 105.0),)
    np.testing.assert_array_equal(prepared.people.masks[0], mask[0, rows, columns])
    assert prepared.known.lengths[0].start == (1.0, 2.0)
    camera = Intrinsics.from_focal(400, 320, 240, trust="known")
    assert prepared.photo.intrinsics == camera
    of_whole = PhotoSettings(depth="depth.npy")  # whose pixels are those of the file
    assert prepare_photo(Photo(whole), of_whole, None, None).border is None


@pytest.fixture(scope="module")
def plain(few_steps):
    """The result of a photo without a border."""
    return reconstruct(load_world("stand", (160, 120)).image, "mock")


@pytest.mark.usefixtures("few_steps")
@pytest.mark.parametrize("name", ["a strip at one side", "a frame of 10 %"])
def test_a_result_is_that_of_the_picture_inside_in_px_of_the_whole(plain, name):
    whole, inside = with_border(plain.image, name)
    found = reconstruct(whole, "mock")
    np.testing.assert_array_equal(found.image, whole)
    assert (found.intrinsics.height, found.intrinsics.width) == whole.shape[:2]
    np.testing.assert_array_equal(found.scene.valid[inside], plain.scene.valid)
    assert found.scene.valid.sum() == plain.scene.valid.sum()
    assert any("border" in note for note in found.notes)
    corner = np.array([inside[1].start, inside[0].start])
    for one, alone in zip(found.people, plain.people, strict=True):
        np.testing.assert_allclose(one.vertices, alone.vertices, atol=1e-4)
        np.testing.assert_array_equal(one.mask[inside], alone.mask)
        assert one.mask.sum() == alone.mask.sum()
        np.testing.assert_allclose(one.box, alone.box + np.tile(corner, 2), atol=1e-3)
        np.testing.assert_allclose(one.keypoints, alone.keypoints + corner, atol=1e-3)
    offset = found.intrinsics.cx - plain.intrinsics.cx, found.intrinsics.cy - plain.intrinsics.cy
    assert offset == pytest.approx(corner)


def test_a_plain_picture_with_a_few_other_rows_at_its_end_is_no_border():
    photo = np.full((240, 320, 3), 20, np.uint8)
    photo[-5:] = textured(240, 320)[-5:]
    assert find_border(photo) is None
