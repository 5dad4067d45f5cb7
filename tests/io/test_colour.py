"""Colours of files that are not sRGB arrive as their file means them."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image, ImageCms, PngImagePlugin

from physic_core.io.photo import read_photo

from .conftest import PICTURE

SHARES = np.asarray(PICTURE) / 255
LINEAR = np.where(SHARES > 0.04045, ((SHARES + 0.055) / 1.055) ** 2.4, SHARES / 12.92)


def with_gamma(gamma):
    """Options of a PNG."""
    info = PngImagePlugin.PngInfo()
    info.add(b"gAMA", round(gamma * 1e5).to_bytes(4))
    return {"pnginfo": info}


def test_a_linear_png_is_read_as_bright_as_it_is(stored):
    linear = Image.fromarray((255 * LINEAR).round().astype(np.uint8))
    photo = read_photo(stored("PNG", linear, **with_gamma(1.0)))
    error = np.abs(photo.image.astype(float) - np.asarray(PICTURE))
    assert error[np.asarray(PICTURE) > 50].max() <= 4
    assert len(photo.notes) == 1


def profile(name):
    return ImageCms.ImageCmsProfile(ImageCms.createProfile(name)).tobytes()


def wide_profile():
    """sRGB whose red and green are exchanged: colours that differ from sRGB without doubt."""
    content = bytearray(profile("sRGB"))
    red, green = (content.index(tag) for tag in (b"rXYZ", b"gXYZ"))
    content[red : red + 4], content[green : green + 4] = b"gXYZ", b"rXYZ"
    return bytes(content)


def test_the_usual_gamma_and_a_profile_of_srgb_change_nothing(stored):
    for options in (with_gamma(0.45455), {"icc_profile": profile("sRGB")}):
        photo = read_photo(stored("PNG", **options))
        np.testing.assert_array_equal(photo.image, np.asarray(PICTURE))
        assert photo.notes == ()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP", "AVIF"])
def test_a_colour_profile_is_followed(stored, kind):
    options = {"WEBP": {"lossless": True}, "JPEG": {"quality": 100, "subsampling": 0}}
    plain = read_photo(stored(kind, **options.get(kind, {})))
    photo = read_photo(stored(kind, icc_profile=wide_profile(), **options.get(kind, {})))
    error = np.abs(photo.image.astype(float) - plain.image[..., [1, 0, 2]])
    assert error.mean() < 2
    assert photo.notes == ()


def of_bt2020(transfer):
    """A PNG of the picture in BT.2020 with a transfer function, white at 203 cd/m2."""
    to_2020 = np.array(
        [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    )
    light = LINEAR @ to_2020.T
    if transfer == 16:
        power = (light * 203 / 10_000) ** 0.1593017578125
        code = ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375
    else:
        display = light * 203 / 1000
        luminance = display @ [0.2627, 0.678, 0.0593]
        scene = display * np.maximum(luminance, 1e-9)[..., None] ** (1 / 1.2 - 1)
        upper = 0.17883277 * np.log(np.maximum(12 * scene - 0.28466892, 1e-9)) + 0.55991073
        code = np.where(scene <= 1 / 12, np.sqrt(3 * scene), upper)
    info = PngImagePlugin.PngInfo()
    info.add(b"cICP", bytes((9, transfer, 0, 1)))
    return Image.fromarray((255 * code).round().astype(np.uint8)), {"pnginfo": info}


@pytest.mark.parametrize("transfer", [16, 18])
def test_high_dynamic_range_is_converted_with_a_note(stored, transfer):
    image, options = of_bt2020(transfer)
    photo = read_photo(stored("PNG", image, **options))
    error = np.abs(photo.image.astype(float) - np.asarray(PICTURE))
    assert error.mean() < 2.5
    assert ["dynamic range" in note for note in photo.notes] == [True]


def test_code_points_of_an_avif_are_those_of_its_container(stored):
    content = stored("AVIF", PICTURE, quality=100, subsampling="4:4:4")
    path = content if isinstance(content, bytes) else content.read_bytes()
    assert path.count(b"colrnclx") == 1
    hdr = path.replace(b"colrnclx\x00\x01\x00\x0d", b"colrnclx\x00\x09\x00\x10")
    assert hdr != path
    assert np.abs(read_photo(path).image.astype(float) - np.asarray(PICTURE)).mean() < 3
    assert ["dynamic range" in note for note in read_photo(hdr).notes] == [True]


def test_code_points_that_are_not_known_are_named(stored):
    info = PngImagePlugin.PngInfo()
    info.add(b"cICP", bytes((10, 17, 0, 1)))
    assert "10" in read_photo(stored("PNG", PICTURE, pnginfo=info)).notes[0]


def test_a_profile_of_more_than_8_mb_is_not_read(stored):
    large = wide_profile() + bytes(8 << 20)
    photo = read_photo(stored("TIFF", icc_profile=large))
    np.testing.assert_array_equal(photo.image, np.asarray(PICTURE))
    assert ["colour profile" in note for note in photo.notes] == [True]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        *((with_gamma(gamma), "gamma") for gamma in (0.00001, 0.05, 3.5, 20)),
        ({"icc_profile": b"no profile of any kind"}, "colour profile"),
    ],
)
def test_what_no_photo_has_is_ignored_and_named(stored, options, word):
    photo = read_photo(stored("PNG", **options))
    np.testing.assert_array_equal(photo.image, np.asarray(PICTURE))
    assert [word in note for note in photo.notes] == [True]


def test_grey_is_read_by_a_grey_profile(stored):
    content = bytearray(profile("sRGB"))
    content[16:20] = b"GRAY"
    curve = content.index(b"rTRC")
    content[curve : curve + 4] = b"kTRC"
    grey = PICTURE.convert("L")
    photo = read_photo(stored("PNG", grey, icc_profile=bytes(content)))
    np.testing.assert_array_equal(photo.image, np.asarray(grey.convert("RGB")))
    assert ["grey" in note for note in photo.notes] == [True]
