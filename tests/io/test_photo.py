"""Photos in: every kind of file ends in an upright RGB image with notes, or in a message that says what to do."""

from __future__ import annotations

import errno
import math
import os
import struct
import sys
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from physic_core.errors import InputError
from physic_core.io.photo import Photo, check_image, limit_size, read_photo, read_source
from physic_core.types import Intrinsics

WIDTH, HEIGHT = 96, 72
DAMAGED = (
    "its data are damaged or truncated; copy it again from where it came, or save it again from a program that shows "
    "it completely"
)


def corners(width=WIDTH, height=HEIGHT) -> np.ndarray:
    """Red top left, green top right, blue bottom left, white bottom right."""
    image = np.zeros((height, width, 3), np.uint8)
    image[: height // 2, : width // 2, 0] = 255
    image[: height // 2, width // 2 :, 1] = 255
    image[height // 2 :, : width // 2, 2] = 255
    image[height // 2 :, width // 2 :] = 255
    return image


def message_of(path) -> str:
    with pytest.raises(InputError) as caught:
        read_photo(path)
    return str(caught.value)


def save_with_exif(path, orientation=1, size=(WIDTH, HEIGHT), software="", **tags):
    numbers = {"f35": 0xA405, "f": 0x920A, "px": 0xA002, "py": 0xA003, "rx": 0xA20E, "ry": 0xA20F, "unit": 0xA210}
    image = Image.fromarray(corners(*size))
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif[0x0131] = software
    exif.get_ifd(0x8769).update({numbers[name]: value for name, value in tags.items()})
    image.save(path, exif=exif, quality=95)
    return path


# --- what is refused ----------------------------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path):
    path = tmp_path / "missing.jpg"
    assert message_of(path) == f"cannot read the photo {path}: there is no such file; check the path"


def test_something_that_is_not_a_file():
    message = "cannot read the photo /dev/null: it is not a regular file; name one image file"
    assert message_of("/dev/null") == message


def test_an_empty_file_is_refused(tmp_path):
    path = tmp_path / "empty.jpg"
    path.write_bytes(b"")
    assert message_of(path) == f"cannot read the photo {path}: the file is empty (0 bytes); copy it again"


@pytest.mark.parametrize("content", [b"%PDF-1.7 no image", b"\xff\xd8", bytes(range(256)) * 20])
def test_a_file_that_is_no_image_is_refused(tmp_path, content):
    path = tmp_path / "letter.jpg"
    path.write_bytes(content)
    assert message_of(path) == (
        f"cannot read the photo {path}: it is not an image, or of an unknown kind; give a JPEG, PNG, WebP, AVIF or TIFF"
    )


@pytest.mark.parametrize("kind", ["EPS", "ICO", "PCX", "SGI", "TGA"])
def test_other_formats_of_pillow_are_refused(tmp_path, kind):
    path = tmp_path / "photo.jpg"
    Image.new("RGB", (64, 64)).save(path, kind)
    assert "give a JPEG, PNG, WebP, AVIF or TIFF" in message_of(path)


def test_a_jpeg_of_more_than_400_mb_is_refused(tmp_path):
    path = tmp_path / "photo.jpg"
    Image.new("RGB", (64, 64)).save(path)
    os.truncate(path, 400_000_001)
    assert message_of(path) == f"cannot read the photo {path}: {DAMAGED}"


@pytest.mark.parametrize("suffix", ["jpg", "png", "tiff"])
def test_a_truncated_photo_is_refused(tmp_path, suffix):
    path = tmp_path / f"photo.{suffix}"
    noise = np.random.default_rng(0).integers(0, 255, (200, 300, 3), np.uint8)
    Image.fromarray(noise).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 6 // 10])
    assert message_of(path) == f"cannot read the photo {path}: {DAMAGED}"


def jpeg(path, *, width=200, height=120, **options) -> bytes:
    """A JPEG of a picture with plains, edges and noise; its file's content."""
    image = np.zeros((height, width, 3), np.uint8)
    image[: height // 2, : width // 2] = np.random.default_rng(0).integers(0, 255, (height // 2, width // 2, 3))
    image[height // 2 :, :, 1] = np.linspace(0, 255, width)
    Image.fromarray(image).save(path, **options)
    return path.read_bytes()


JPEG_KINDS = [{}, {"progressive": True}, {"restart_marker_blocks": 5}, {"restart_marker_rows": 1}, {"quality": 30}]


@pytest.mark.parametrize("options", JPEG_KINDS, ids=str)
@pytest.mark.parametrize("missing", [1, 2])
def test_a_jpeg_without_its_end_marker_is_read_with_a_note(tmp_path, options, missing):
    path = tmp_path / "photo.jpg"
    whole = jpeg(path, **options)
    assert whole.endswith(b"\xff\xd9")
    expected = read_photo(path)
    path.write_bytes(whole[:-missing])
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, expected.image)
    assert photo.notes == ("the file's last bytes are missing; the image is complete",)
    assert expected.notes == ()


@pytest.mark.parametrize("options", JPEG_KINDS, ids=str)
def test_a_jpeg_with_missing_pixels_is_refused(tmp_path, options):
    path = tmp_path / "photo.jpg"
    whole = jpeg(path, **options)
    head = whole.rindex(b"\xff\xda") + 20
    for end in {*range(head, len(whole) - 8, 97), *range(len(whole) - 40, len(whole) - 8)}:
        path.write_bytes(whole[:end])
        assert message_of(path) == f"cannot read the photo {path}: {DAMAGED}"


HEIC = b"\x00\x00\x00\x18ftypheic\x00\x00\x00\x00mif1heic" + bytes(64)


def test_heic_without_its_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    path = tmp_path / "IMG_0001.HEIC"
    path.write_bytes(HEIC)
    assert message_of(path) == (
        f"cannot read the photo {path}: it is HEIC, which needs one more package; "
        "run `pip install pi-heif`, or convert the photo to JPEG"
    )


def test_a_photo_of_eight_pixels_is_refused(tmp_path):
    path = tmp_path / "tiny.png"
    Image.new("RGB", (8, 8)).save(path)
    assert message_of(path) == (
        f"cannot use the photo {path}: it is 8 x 8 px, but each side needs at least 64 px; give a larger photo"
    )


@pytest.mark.parametrize("side", [13_000, 30_000])
def test_a_photo_of_too_many_pixels_is_refused(tmp_path, side):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    path = tmp_path / "huge.png"
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b""))
    assert message_of(path) == (f"cannot use the photo {path}: it has more than 150 megapixels; give a smaller version")


def test_pixels_of_32_bits_are_refused(tmp_path):
    path = tmp_path / "counts.tiff"
    Image.fromarray(np.full((HEIGHT, WIDTH), 1 << 20, np.int32)).save(path)
    assert message_of(path) == f"cannot use the photo {path}: its pixels have 32 bits; save it with 8 bits per channel"


def test_a_photo_that_may_not_be_read(tmp_path, monkeypatch):
    def refuse(*_):  # root may read everything, so that a mode of 0 would not do
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    path = tmp_path / "mine.png"
    Image.fromarray(corners()).save(path)
    monkeypatch.setattr(os, "open", refuse)
    assert message_of(path) == f"cannot read the photo {path}: Permission denied; check who may read it"


# --- what is converted --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["png", "webp", "bmp", "tiff", "gif"])
def test_a_plain_photo_comes_as_it_is_without_notes(tmp_path, suffix):
    path = tmp_path / f"photo.{suffix}"
    Image.fromarray(corners()).save(path, **({"lossless": True} if suffix == "webp" else {}))
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, corners())
    assert photo.image.dtype == np.uint8
    assert photo.image.flags.writeable
    assert photo.image.flags.c_contiguous
    assert (photo.intrinsics, photo.notes) == (None, ())


def test_cmyk_is_converted_with_a_note(tmp_path):
    path = tmp_path / "print.jpg"
    Image.fromarray(corners()).convert("CMYK").save(path, quality=95)
    photo = read_photo(path)
    assert np.abs(photo.image.astype(int) - corners()).mean() < 8
    assert photo.notes == ("CMYK colours were converted to RGB without a colour profile",)


def test_a_grey_photo_becomes_rgb_with_a_note(tmp_path):
    path = tmp_path / "grey.png"
    grey = corners()[..., 0] // 2
    Image.fromarray(grey).save(path)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, np.repeat(grey[..., None], 3, -1))
    assert photo.notes == ("the photo is grey: its one channel is used for red, green and blue",)


def test_a_black_and_white_photo_becomes_rgb_with_a_note(tmp_path):
    path = tmp_path / "fax.png"
    Image.fromarray(corners()[..., 0] > 0).save(path)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, np.repeat(corners()[..., :1], 3, -1))
    assert photo.notes == ("the photo is grey: its one channel is used for red, green and blue",)


def test_16_bit_grey_is_scaled_to_8_with_a_note(tmp_path):
    path = tmp_path / "deep.png"
    deep = np.linspace(0, 65535, HEIGHT * WIDTH).round().astype(np.uint16).reshape(HEIGHT, WIDTH)
    Image.fromarray(deep).save(path)
    photo = read_photo(path)
    assert np.abs(photo.image[..., 0] - deep / 257.0).max() <= 0.5 + 1e-9
    assert photo.notes == (
        "16 bits per channel were scaled to 8",
        "the photo is grey: its one channel is used for red, green and blue",
    )


def test_16_bit_rgb_is_scaled_to_8_with_a_note(tmp_path):
    import cv2

    path = tmp_path / "deep.png"
    assert cv2.imwrite(str(path), corners()[..., ::-1].astype(np.uint16) * 257)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, corners())
    assert photo.notes == ("16 bits per channel were scaled to 8",)


def test_alpha_is_laid_over_mid_grey(tmp_path):
    path = tmp_path / "cutout.png"
    alpha = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
    alpha[:, :48] = 0
    Image.fromarray(np.concatenate([corners(), alpha], -1)).save(path)
    photo = read_photo(path)
    assert (photo.image[:, :48] == 128).all()
    np.testing.assert_array_equal(photo.image[:, 48:], corners()[:, 48:])
    assert photo.notes == ("transparent parts were composited over mid-grey",)


def test_an_alpha_channel_that_hides_nothing_goes_silently(tmp_path):
    path = tmp_path / "opaque.png"
    Image.fromarray(corners()).convert("RGBA").save(path)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, corners())
    assert photo.notes == ()


def test_grey_with_alpha_is_laid_over_mid_grey(tmp_path):
    path = tmp_path / "grey.png"
    pixels = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    pixels[..., 0], pixels[:10, :, 1] = 200, 255
    Image.fromarray(pixels).save(path)
    photo = read_photo(path)
    assert (photo.image[:10] == 200).all()
    assert (photo.image[10:] == 128).all()
    assert photo.notes == (
        "transparent parts were composited over mid-grey",
        "the photo is grey: its one channel is used for red, green and blue",
    )


def test_a_palette_becomes_rgb_without_a_note(tmp_path):
    path = tmp_path / "palette.png"
    Image.fromarray(corners()).convert("P", palette=Image.Palette.ADAPTIVE, colors=4).save(path)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, corners())
    assert photo.notes == ()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_photo_comes_upright(tmp_path, orientation):
    turn = {
        1: lambda a: a,
        2: lambda a: a[:, ::-1],
        3: lambda a: a[::-1, ::-1],
        4: lambda a: a[::-1],
        5: lambda a: a.transpose(1, 0, 2),
        6: lambda a: np.rot90(a, 1),
        7: lambda a: a[::-1, ::-1].transpose(1, 0, 2),
        8: lambda a: np.rot90(a, -1),
    }[orientation]
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "turned.png"
    Image.fromarray(np.ascontiguousarray(turn(corners()))).save(path, exif=exif)
    photo = read_photo(path)
    np.testing.assert_array_equal(photo.image, corners())
    assert photo.file_size is None  # the image is all of it
    assert photo.notes == (() if orientation == 1 else ("rotated upright according to the EXIF orientation",))


def test_eighty_megapixels_are_read_at_half_size(tmp_path):
    path = tmp_path / "large.jpg"
    tile = Image.fromarray(corners(10_000, 8_000))
    tile.save(path, quality=50)
    photo = read_photo(path)
    assert photo.image.shape == (4000, 5000, 3)
    assert photo.notes == ("80 megapixels were read at 5000 x 4000 px",)
    assert photo.file_size == (10_000, 8_000)
    assert np.abs(photo.image[::40, ::40].astype(int) - corners(125, 100)).mean() < 2


# --- what the file says about the camera --------------------------------------------------------------------------


def test_the_35_mm_equivalent_is_read_by_the_diagonal(tmp_path):
    photo = read_photo(save_with_exif(tmp_path / "a.jpg", f35=26))
    focal = 26 * math.hypot(WIDTH, HEIGHT) / math.hypot(36, 24)
    assert photo.intrinsics == Intrinsics(
        focal, focal, 47.5, 35.5, WIDTH, HEIGHT, "EXIF: 26 mm (35 mm equivalent, by the diagonal)", "known"
    )
    assert photo.notes == ()


def test_a_turned_photo_swaps_the_focal_lengths(tmp_path):
    path = save_with_exif(
        tmp_path / "a.jpg", orientation=6, size=(360, 240), f=50.0, rx=100.0, ry=110.0, unit=3, px=360, py=240
    )
    intrinsics = read_photo(path).intrinsics
    assert intrinsics is not None
    assert (intrinsics.width, intrinsics.height) == (240, 360)
    assert intrinsics.fx == pytest.approx(550, rel=1e-6)
    assert intrinsics.fy == pytest.approx(500, rel=1e-6)


def test_the_size_and_the_software_in_the_tags_are_compared_with_the_file(tmp_path):
    photo = read_photo(save_with_exif(tmp_path / "a.jpg", f35=26, px=4000, py=3000))
    assert photo.intrinsics is None
    assert "4000 x 3000 px" in photo.notes[0]
    photo = read_photo(save_with_exif(tmp_path / "b.jpg", software="Snapseed 2.0", f35=26))
    assert photo.intrinsics is None
    assert "Snapseed" in photo.notes[0]


def test_an_impossible_focal_length_is_ignored(tmp_path):
    photo = read_photo(save_with_exif(tmp_path / "a.jpg", f35=4000))
    assert photo.intrinsics is None
    assert photo.notes == (
        "the focal length in the EXIF data was ignored: 1.2e+02 times the long side is not plausible",
    )


@pytest.mark.parametrize(
    "tags", [{"f35": 0}, {"f": 0.0, "rx": 100.0}, {"f": 50.0}, {"f": 50.0, "rx": 100.0, "unit": 9}]
)
def test_an_unknown_focal_length_is_unknown(tmp_path, tags):
    photo = read_photo(save_with_exif(tmp_path / "a.jpg", **tags))
    assert (photo.intrinsics, photo.notes) == (None, ())


def test_a_broken_exif_block_only_loses_the_camera(tmp_path):
    path = tmp_path / "a.jpg"
    Image.fromarray(corners()).save(path, exif=b"Exif\x00\x00II*\x00\xff\xff\xff\xff garbage")
    photo = read_photo(path)
    assert photo.image.shape == (HEIGHT, WIDTH, 3)
    assert photo.intrinsics is None


# --- resizing -----------------------------------------------------------------------------------------------------


def test_resizing_averages_and_moves_the_camera_along():
    image = corners(400, 300)
    photo = limit_size(Photo(image, Intrinsics(300.0, 310.0, 199.5, 149.5, 400, 300), ("note",)), 200)
    np.testing.assert_array_equal(photo.image, image.reshape(150, 2, 200, 2, 3).mean((1, 3)).round().astype(np.uint8))
    assert photo.intrinsics == Intrinsics(150.0, 155.0, 99.5, 74.5, 200, 150)
    assert photo.notes == ("note",)


@given(
    width=st.integers(100, 300),
    height=st.integers(100, 300),
    side=st.integers(70, 400),
    x=st.floats(-1, 1),
    y=st.floats(-1, 1),
)
def test_a_ray_meets_the_same_spot_of_the_resized_photo(width, height, side, x, y):
    before = Intrinsics.from_focal(250.0, width, height)
    photo = Photo(np.zeros((height, width, 3), np.uint8), before)
    try:
        after = limit_size(photo, side).intrinsics
    except InputError:
        assert min(width, height) * side / max(width, height) < 64.5
        return
    assert after is not None
    spot = (before.fx * x + before.cx + 0.5) / width, (before.fy * y + before.cy + 0.5) / height
    assert (after.fx * x + after.cx + 0.5) / after.width == pytest.approx(spot[0])
    assert (after.fy * y + after.cy + 0.5) / after.height == pytest.approx(spot[1])


def test_an_image_of_extreme_aspect_is_refused():
    with pytest.raises(InputError) as caught:
        limit_size(Photo(np.zeros((80, 2000, 3), np.uint8)), 1000)
    assert str(caught.value) == (
        "the photo is too long and thin: at a long side of 1000 px, its 2000 x 80 px become 1000 x 40 px, "
        "but each side needs 64 px; crop it, or allow a longer side"
    )


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (
            Intrinsics.from_focal(1e7, 200, 100),
            "the focal length is 5e+04 times the long side of the photo, but should be 0.1 to 100 times: "
            "give it in px of the photo file",
        ),
        (
            Intrinsics(200.0, 1.0, 99.5, 49.5, 200, 100),
            "the focal length is 0.005 times the long side of the photo, but should be 0.1 to 100 times: "
            "give it in px of the photo file",
        ),
        (
            Intrinsics(200.0, 200.0, 99.5, -5000.0, 200, 100),
            "the principal point (99.5, -5000) lies outside the photo of 200 x 100 px: give it in px of the photo "
            "file, or give only the focal length",
        ),
        (
            Intrinsics(200.0, 200.0, 199.6, 49.5, 200, 100),
            "the principal point (199.6, 49.5) lies outside the photo of 200 x 100 px: give it in px of the photo "
            "file, or give only the focal length",
        ),
        (
            Intrinsics(float("nan"), 200.0, 99.5, 49.5, 200, 100),
            "the focal length is nan times the long side of the photo, but should be 0.1 to 100 times: "
            "give it in px of the photo file",
        ),
        (
            Intrinsics.from_focal(400.0, 400, 200),
            "the intrinsics are for 400 x 200 px, but the image has 200 x 100 px: "
            "give those of this image, or intrinsics.resized(200, 100) if it was only resized",
        ),
    ],
)
@pytest.mark.parametrize("max_side", [128, 1280])
def test_a_camera_that_cannot_be_the_photos_is_refused(camera, message, max_side):
    with pytest.raises(InputError) as caught:
        limit_size(Photo(np.zeros((100, 200, 3), np.uint8), camera), max_side)
    assert str(caught.value) == message


# --- arrays -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (
            "photo.jpg",
            "image must be a numpy array (H, W, 3) of uint8 RGB, got str: "
            "give a path, the bytes of a file, a PIL image, or convert it",
        ),
        (np.zeros((72, 96)), "image must be uint8 with values 0-255, got float64: scale it to 0-255 and convert it"),
        (np.zeros((1, 72, 96, 3), np.uint8), "image must be (H, W, 3), got (1, 72, 96, 3): drop the batch axis"),
        (np.zeros((2, 72, 96, 3), np.uint8), "image must be (H, W, 3), got (2, 72, 96, 3): give one image at a time"),
        (np.zeros((3, 72, 96), np.uint8), "image must be (H, W, 3), got (3, 72, 96): put the channels last"),
        (np.zeros(5, np.uint8), "image must be (H, W, 3), got (5,): give one RGB image"),
        (np.zeros((72, 96, 3)), "image must be uint8 with values 0-255, got float64: scale it to 0-255 and convert it"),
        (np.zeros((72, 96, 3), np.int64), "image must be uint8 with values 0-255, got int64: convert it"),
        (np.zeros((8, 8, 3), np.uint8), "image is 8 x 8 px, but each side needs at least 64 px: give a larger one"),
    ],
)
def test_a_bad_array_is_refused(image, message):
    with pytest.raises(InputError) as caught:
        check_image(image)
    assert str(caught.value) == message


# --- panoramas -----------------------------------------------------------------------------------------------------


def panorama(*, wraps: bool) -> np.ndarray:
    """A picture (256, 512) of smooth patches with the noise of a camera; its first column continues its last or not."""
    rng = np.random.default_rng(0)
    patches = Image.fromarray(rng.integers(0, 256, (8, 8 if wraps else 16, 3), dtype=np.uint8))
    image = np.asarray(patches.resize((256 if wraps else 512, 256), Image.Resampling.BICUBIC)).astype(int)
    if wraps:
        image = np.roll(np.concatenate([image, image[:, ::-1]], axis=1), 100, axis=1)
    return np.clip(image + rng.integers(-3, 4, image.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_a_picture_that_wraps_round_is_refused(tmp_path, suffix):
    path = tmp_path / f"panorama{suffix}"
    Image.fromarray(panorama(wraps=True)).save(path)
    assert "perspective view" in message_of(path)
    with pytest.raises(InputError, match="equirectangular"):
        read_source(panorama(wraps=True))


def test_a_photo_of_another_aspect_may_wrap_round():
    image = panorama(wraps=True)[:200]
    np.testing.assert_array_equal(read_source(image).image, image)


@pytest.mark.parametrize("edges", ["different", "plain", "level"])
def test_an_ordinary_photo_twice_as_wide_as_high_is_used(tmp_path, edges):
    image = panorama(wraps=False)
    if edges == "plain":
        image[:, :40] = image[:, -40:] = 255
    elif edges == "level":  # like a sky over the sea
        image[:] = np.linspace(0, 255, 256)[:, None, None]
    Image.fromarray(image).save(tmp_path / "photo.png")
    np.testing.assert_array_equal(read_photo(tmp_path / "photo.png").image, image)


@pytest.mark.parametrize("suffix", [".jpg", ".webp", ".tif"])
def test_a_panorama_with_its_metadata_is_refused(tmp_path, suffix):
    xmp = b'<rdf:Description GPano:ProjectionType="equirectangular"/>'
    path = tmp_path / f"panorama{suffix}"
    options = {"tiffinfo": {700: xmp}} if suffix == ".tif" else {"xmp": xmp}
    Image.fromarray(panorama(wraps=False)).save(path, **options)
    assert "equirectangular" in message_of(path)
