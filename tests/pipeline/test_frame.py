"""What is round the picture in a file: screenshots, prints, screens, albums."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from physic_core.configuration.model import PhotoSettings
from physic_core.io.photo import Photo
from physic_core.prepare.frame import find_frame, smooth_background
from physic_core.prepare.photo import prepare_photo
from physic_core.types import Intrinsics
from tests.pipeline.pictures import as_jpeg, textured

HEIGHT = 480
WIDTH = 640


EXAMPLES = Path(__file__).parents[2] / "examples"


@cache
def grainy(seed):
    return noisy(textured(HEIGHT, WIDTH, seed), 6)


def picture(seed=0):
    """Patches with grain, as photos have."""
    return grainy(seed).copy()


def on(ground, image, matrix):
    """The image on a ground, placed by a homography (3, 3)."""
    size = ground.shape[1::-1]
    put = cv2.warpPerspective(image, matrix, size, flags=cv2.INTER_AREA)
    share = cv2.warpPerspective(np.full(image.shape, 255, np.uint8), matrix, size) / 255
    return (ground * (1 - share) + put * share).astype(np.uint8)


def turned(degrees, x, y):
    """Homography that turns about the upper left corner, which it puts at x, y."""
    matrix = np.eye(3)
    matrix[:2, :2] = cv2.getRotationMatrix2D((0, 0), degrees, 1)[:, :2]
    matrix[:2, 2] = x, y
    return matrix


def noisy(image, sigma=3.0):
    noise = np.random.default_rng(1).normal(0, sigma, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def with_bars(top, bottom, ground, ink):
    """A picture between bars with text."""
    whole = np.full((HEIGHT + top + bottom, WIDTH, 3), ground, np.uint8)
    whole[top : top + HEIGHT] = picture()
    for y in (top // 2 + 8, top + HEIGHT + bottom // 2 + 8):
        cv2.putText(whole, "9:41  IMG 2041.jpg  share", (30, y), 0, 0.8, ink, 2)
    return whole, (slice(top, top + HEIGHT), slice(0, WIDTH))


def assert_close(found, inside, error=6):
    assert found is not None
    for part, true in zip(found, inside, strict=True):
        assert true.start <= part.start <= true.start + error
        assert true.stop - error <= part.stop <= true.stop


@pytest.mark.parametrize("bars", [(80, 100), (60, 240)])
@pytest.mark.parametrize(("ground", "ink"), [(255, (0, 0, 0)), (18, (240, 240, 240))])
def test_bars_with_ink_are_cut(bars, ground, ink):
    whole, inside = with_bars(*bars, ground, ink)
    for photo in (whole, as_jpeg(whole), noisy(whole, 1)):
        frame = find_frame(photo)
        assert_close(frame.inside, inside)
        assert not frame.warning
        assert not frame.is_print


@pytest.mark.parametrize("degrees", [0, 2.5, -4])
@pytest.mark.parametrize("bed", [(225, 225, 222), (35, 36, 38)])
def test_a_scanned_print_is_cut_out_of_its_white_and_the_bed(degrees, bed):
    mounted = np.full((HEIGHT + 60, WIDTH + 60, 3), (238, 226, 204), np.uint8)
    mounted[30:-30, 30:-30] = picture()
    scan = noisy(on(np.full((800, 960, 3), bed, np.uint8), mounted, turned(degrees, 110, 130)))
    frame = find_frame(scan)
    assert frame.is_print == (degrees != 0)
    middle = turned(degrees, 110, 130) @ [30 + WIDTH / 2, 30 + HEIGHT / 2, 1]
    lost = (WIDTH + HEIGHT) * np.sin(np.radians(abs(degrees)))
    for part, at, whole in zip(frame.inside, middle[1::-1], (HEIGHT, WIDTH), strict=True):
        assert (part.start + part.stop) / 2 == pytest.approx(at, abs=6)
        assert whole - lost - 16 <= part.stop - part.start <= whole


def test_the_camera_of_a_photo_of_a_print_is_not_the_prints():
    scan = on(np.full((700, 860, 3), 30, np.uint8), picture(), turned(2, 90, 120))
    camera = Intrinsics.from_focal(900, 860, 700, source="EXIF: 28 mm")
    by_file, given = (
        prepare_photo(Photo(scan, camera), PhotoSettings(focal_px=focal), None, None).photo
        for focal in (None, 800)
    )
    assert by_file.intrinsics is None
    assert given.intrinsics.fx == 800


@pytest.mark.parametrize("bezel", [12, 240])
def test_a_screen_that_is_askew_is_warned_of(bezel):
    rng = np.random.default_rng(0)
    room = cv2.resize(rng.uniform(60, 200, (60, 80, 3)), (1000, 800)).astype(np.uint8)
    screen = np.full((HEIGHT + 50, WIDTH + 50, 3), bezel, np.uint8)
    screen[25:-25, 25:-25] = picture()
    before = np.float32([[0, 0], [690, 0], [690, 530], [0, 530]])
    after = np.float32([[120, 90], [860, 150], [840, 640], [140, 700]])
    frame = find_frame(on(noisy(room, 8), screen, cv2.getPerspectiveTransform(before, after)))
    assert frame.inside is None
    assert "picture" in frame.warning


def test_a_print_on_wood_is_warned_of():
    grain = np.random.default_rng(0).normal(0, 14, (200, 6))
    wood = np.array([150.0, 100.0, 60.0]) + cv2.resize(grain, (960, 800))[..., None]
    photo = on(noisy(wood), picture(), turned(3, 110, 130))
    (warning,) = prepare_photo(Photo(photo), PhotoSettings(), None, None).photo.warnings
    assert "picture" in warning


def test_the_blurred_sides_of_an_upright_film_are_cut():
    film = picture()[:, :280]
    whole = cv2.GaussianBlur(cv2.resize(film, (880, 1508))[500:980], (0, 0), 25)
    whole[:, 300:580] = film
    assert_close(find_frame(as_jpeg(whole)).inside, (slice(0, HEIGHT), slice(300, 580)))


@pytest.mark.parametrize("gap", [0, 2, 8, 40])
@pytest.mark.parametrize("rows_and_columns", [(1, 2), (2, 1), (2, 2), (3, 3)])
def test_pictures_between_strips_of_any_width_are_counted(gap, rows_and_columns):
    rows, columns = rows_and_columns
    color = (0, 128, 255)[(gap + rows + 2 * columns) % 3]  # each beside each gap
    sheet = np.full((rows * 200 + gap * (rows - 1), columns * 300 + gap * (columns - 1), 3), color)
    for number in range(rows * columns):
        top, left = (number // columns) * (200 + gap), (number % columns) * (300 + gap)
        part = picture(number)[100:300, 100:400]
        sheet[top : top + 200, left : left + 300] = part
    sheet = sheet.astype(np.uint8)
    framed = cv2.copyMakeBorder(sheet, *[20] * 4, 0, value=(color,) * 3)
    for photo in (sheet, framed, as_jpeg(sheet)) if gap != 2 else (sheet, framed):
        assert f"{rows * columns} pictures" in find_frame(photo).warning


@pytest.mark.parametrize("axis", [0, 1])
def test_two_pictures_of_two_sizes_are_counted(axis):
    sheet = np.concatenate([picture(0)[:200, :400], picture(1)[:333, :400]])
    photo = np.ascontiguousarray(sheet.swapaxes(0, axis))
    for one in (photo, as_jpeg(photo)):
        assert "2 pictures" in find_frame(one).warning


def test_a_bar_that_somebody_stands_before_parts_no_pictures():
    photo = picture()
    photo[200:210] = 90
    photo[100:400, 300:360] = picture(1)[100:400, 300:360]
    assert find_frame(photo).warning == ""


def test_a_scene_with_straight_edges_is_no_frame():
    """The sea under a sky of one hue, also in the middle, walls that meet, a doorway."""
    sea = np.concatenate([np.full((160, WIDTH, 3), (200, 220, 240), np.uint8), picture()])
    sea[:160] = sea[:160] - np.linspace(0, 24, 160)[:, None, None].astype(np.uint8)
    room = picture()
    room[:, :200] = noisy(np.full((HEIGHT, 200, 3), 200) - np.linspace(0, 16, 200)[:, None], 3)
    for photo in (noisy(sea, 1), as_jpeg(noisy(sea, 1)), noisy(sea[:320], 1), room):
        frame = find_frame(photo)
        assert frame.inside is None
        assert not frame.warning


@pytest.mark.parametrize("ground", [0, 255])
def test_two_people_on_a_plain_ground_are_one_photo(ground):
    photo = np.full((240, 400, 3), ground, np.uint8)
    for x in (60, 260):
        photo[100:, x : x + 80] = textured(140, 80)
    assert not find_frame(photo).warning
    assert not find_frame(as_jpeg(photo)).warning


@pytest.mark.parametrize("photo", sorted(EXAMPLES.glob("*.jpg")), ids=lambda path: path.stem)
def test_photos_of_the_examples_have_no_frame(photo):
    frame = find_frame(np.asarray(Image.open(photo)))
    assert frame.inside is None
    assert not frame.warning


@pytest.mark.parametrize("ground", [0, 128, 255])
def test_a_plain_ground_is_what_reaches_the_edge_in_one_colour(ground):
    photo = np.full((HEIGHT, WIDTH, 3), ground, np.uint8)
    photo[100:, 200:440] = picture()[100:, 200:440]
    found = smooth_background(noisy(photo, 1))
    wanted = np.ones((HEIGHT, WIDTH), bool)
    wanted[100:, 200:440] = False
    assert (found == wanted).mean() > 0.98


def test_a_shaded_wall_and_a_small_sky_are_no_plain_ground():
    wall = np.linspace(150, 220, WIDTH)[None, :, None] * np.ones((HEIGHT, 1, 3))
    assert smooth_background(noisy(wall, 2)) is None
    sky = picture()
    sky[:100] = 255
    assert smooth_background(sky) is None


def warnings_of(image):
    return prepare_photo(Photo(image), PhotoSettings(), None, None).photo.warnings


@pytest.mark.parametrize("turn", [0, 100, 333])
def test_a_panorama_without_metadata_is_warned_of(turn):
    half = picture()[:, :HEIGHT]
    whole = np.roll(np.concatenate([half, half[:, ::-1]], axis=1), turn, axis=1)
    (warning,) = warnings_of(whole)
    assert "panorama" in warning
    assert not warnings_of(noisy(textured(HEIGHT, 2 * HEIGHT), 6))


def test_a_strip_is_wider_than_photos_are():
    (warning,) = warnings_of(noisy(textured(HEIGHT, 3 * HEIGHT), 6))
    assert "panorama" in warning
    assert not warnings_of(noisy(textured(3 * HEIGHT, HEIGHT), 6))


def test_a_photo_that_is_almost_black_is_warned_of():
    """Of a night with lights, too little is black."""
    night = (picture() / 10).astype(np.uint8)
    (warning,) = warnings_of(night)
    assert "dark" in warning
    night[200:300, 100:400] = picture()[200:300, 100:400]
    assert not warnings_of(night)


def test_a_blurred_photo_is_warned_of():
    """One sharp thing in it is enough."""
    photo = cv2.GaussianBlur(picture(), (0, 0), 9)
    (warning,) = warnings_of(photo)
    assert "blurred" in warning
    photo[200:300, 300:400] = (0, 60, 30)
    assert not warnings_of(photo)
