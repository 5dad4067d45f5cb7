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


def stripes(colors):
    return np.uint8(colors)[None].repeat(72, 0).repeat(32, 1)


def with_code_points(*points):
    """Options of a PNG."""
    info = PngImagePlugin.PngInfo()
    info.add(b"cICP", bytes((*points, 0, 1)))
    return {"pnginfo": info}


@pytest.mark.parametrize(
    ("transfer", "codes"),
    [
        (16, [[148, 148, 148], [136, 83, 56], [84, 92, 131]]),
        (18, [[191, 191, 191], [181, 68, 33], [73, 87, 177]]),
    ],
    ids=["PQ", "HLG"],
)
def test_high_dynamic_range_is_converted_with_a_note(stored, transfer, codes):
    """White is at 58 % of PQ and 75 % of HLG by ITU-R BT.2408; of the others the codes in BT.2020
    were computed by BT.2087 and BT.2100.
    """
    picture = Image.fromarray(stripes(codes))
    photo = read_photo(stored("PNG", picture, **with_code_points(9, transfer)))
    expected = stripes([[255, 255, 255], [255, 0, 0], [40, 90, 200]])
    assert np.abs(photo.image.astype(float) - expected).max() <= 6
    assert ["dynamic range" in note for note in photo.notes] == [True]


def test_code_points_of_an_avif_are_those_of_its_container(stored):
    plain = stored("AVIF", quality=100, subsampling="4:4:4")
    hdr = plain.replace(b"colrnclx\x00\x01\x00\x0d", b"colrnclx\x00\x09\x00\x10")
    assert hdr != plain
    assert np.abs(read_photo(plain).image.astype(float) - np.asarray(PICTURE)).mean() < 3
    assert ["dynamic range" in note for note in read_photo(hdr).notes] == [True]


def test_code_points_that_are_not_known_are_named(stored):
    assert "10" in read_photo(stored("PNG", **with_code_points(10, 17))).notes[0]


def test_a_profile_of_more_than_8_mb_is_not_read(stored):
    large = wide_profile() + bytes(8 << 20)
    photo = read_photo(stored("TIFF", icc_profile=large))
    np.testing.assert_array_equal(photo.image, np.asarray(PICTURE))
    assert ["color profile" in note for note in photo.notes] == [True]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        *((with_gamma(gamma), "gamma") for gamma in (0.00001, 0.05, 3.5, 20)),
        ({"icc_profile": b"no profile of any kind"}, "color profile"),
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
    assert ["gray" in note for note in photo.notes] == [True]
