"""Focal lengths from the EXIF blocks of 17 cameras, phones and editors: each is right, or not
known.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.io.exif import intrinsics_from_exif

_TAGS = {
    "software": 0x0131,
    "mm": 0x920A,
    "film": 0xA405,
    "w": 0xA002,
    "h": 0xA003,
    "make": 0x010F,
    "plane_x": 0xA20E,
    "plane_y": 0xA20F,
    "unit": 0xA210,
    "zoom": 0xA404,
    "file_w": 0x0100,
    "file_h": 0x0101,
    "camera_w": 0x1001,
    "camera_h": 0x1002,
    "changed": 0x0132,
    "taken": 0x9003,
    "note": 0x927C,
}
_NOON, _LATER = "2026:05:01 12:00:00", "2026:05:02 08:00:00"
_INCH = 2
_CM = 3

IPHONE_12 = {"software": "14.4", "mm": 4.2, "film": 26, "w": 4032, "h": 3024}
D750 = {"software": "NIKON D750 Ver.1.12", "mm": 50.0, "film": 50, "w": 6016, "h": 4016}
EOS_1DX = {
    "mm": 50.0,
    "w": 5184,
    "h": 3456,
    "plane_x": 5184000 / 1454,
    "plane_y": 3456000 / 969,
    "unit": _INCH,
}
EOS_5D2 = {"w": 5616, "h": 3744, "plane_x": 5616000 / 1459, "plane_y": 3744000 / 958, "unit": _INCH}
EOS_40D = {
    "mm": 35.0,
    "w": 3888,
    "h": 2592,
    "plane_x": 3888000 / 876,
    "plane_y": 2592000 / 583,
    "unit": _INCH,
}
ALPHA_7M3 = {
    "mm": 85.0,
    "film": 85,
    "w": 6000,
    "h": 4000,
    "plane_x": 1675.26,
    "plane_y": 1675.26,
    "unit": _CM,
}

PLANE_OF_ALPHA = {name: value for name, value in ALPHA_7M3.items() if name != "film"}

# name, tags, size of the file in px, true width of the sensor in mm that the file shows, whether
# the lens is known. The widths are the makers'; of phones, the pitch of the pixels times their
# number.
BLOCKS = [
    ("Apple iPhone 12", IPHONE_12, (4032, 3024), 4032 * 0.0014, True),
    ("Samsung Galaxy S7, "
     "stored turned", {"mm": 4.2, "film": 26, "w": 4032, "h": 3024}, (3024, 4032), 5.645, True),
    ("Nikon D750", D750, (6016, 4016), 35.9, True),
    ("Nikon D500, 500 mm", {"mm": 500.0, "film": 750, "w": 5568, "h": 3712}, (5568, 3712), 23.5, False),  # noqa: E501
    ("Sony ILCE-7M3", {"software": "ILCE-7M3 v3.10", **ALPHA_7M3}, (6000, 4000), 35.6, True),
    ("Panasonic DMC-GX80", {"software": "Ver.1.0", "mm": 20.0, "film": 40}, (4592, 3448), 17.3, True),  # noqa: E501
    ("Canon EOS 5D Mark II", {"mm": 50.0, **EOS_5D2}, (5616, 3744), 35.8, True),
    ("EOS-1D X, reduced by Photoshop, tags rewritten",
     {**EOS_1DX, "software": "Adobe Photoshop Elements 9.0", "w": 800, "h": 533}, (800, 533), 36.0, False),  # noqa: E501
    ("EOS-1D X, the same without a "
     "software tag", {**EOS_1DX, "w": 480, "h": 320}, (480, 320), 36.0, False),
    ("EOS 40D, cropped by Photoshop", {**EOS_40D, "software": "Adobe Photoshop CS5 Windows", "w": 2000, "h": 2000},  # noqa: E501
     (2000, 2000), 22.2 * 2000 / 3888, False),
    ("ILCE-7M3, whole, by Lightroom", {**ALPHA_7M3, "software": "Adobe Photoshop Lightroom "
                                                                "Classic 10.0"},
     (6000, 4000), 35.6, True),
    ("ILCE-7M3, cropped by Lightroom, tags rewritten",
     {**ALPHA_7M3, "software": "Adobe Photoshop Lightroom Classic 10.0", "w": 3000, "h": 2000},
     (3000, 2000), 17.8, False),
    ("iPhone 12, cropped by Snapseed", {**IPHONE_12, "software": "Snapseed 2.0"}, (2400, 3024), 3.36, False),  # noqa: E501
    ("Samsung Galaxy S10, 16:9", {"mm": 4.3, "film": 26, "w": 4032, "h": 2268}, (4032, 2268), 5.645, False),  # noqa: E501
    ("iPhone 12, cropped, no size in the tags", {"mm": 4.2, "film": 26}, (2400, 3024), 3.36, False),
    ("Canon EOS 40D, one resolution of "
     "the plane wrong", {**EOS_40D, "plane_y": 300.0}, (3888, 2592), 22.2, False),
    ("a phone that zooms ten "
     "times by cropping", {"mm": 4.3, "film": 312}, (4032, 3024), 0.47, False),
]  # fmt: skip


def read(tags, size, thumbnail=None):
    numbers = {_TAGS[name]: value for name, value in tags.items()}
    return intrinsics_from_exif(numbers, size, *size, thumbnail=thumbnail)


@pytest.mark.parametrize(
    ("tags", "size", "sensor_mm", "is_known"), [b[1:] for b in BLOCKS], ids=[b[0] for b in BLOCKS]
)
def test_a_focal_length_is_right_or_not_known(tags, size, sensor_mm, is_known):
    camera, notes = read(tags, size)
    assert (camera is not None) == is_known
    assert not notes or not is_known or not camera.known
    if camera is not None:
        assert max(camera.fx, camera.fy) == pytest.approx(
            tags["mm"] / sensor_mm * max(size), rel=0.06
        )


@pytest.mark.parametrize(
    ("tags", "thumbnail", "is_known"),
    [
        (ALPHA_7M3, None, True),
        ({**ALPHA_7M3, "software": "Adobe Photoshop Lightroom 10.0"}, None, True),
        ({"mm": 85.0, "film": 85, "note": b"."}, None, False),
        ({"mm": 85.0, "film": 85}, 1.0, False),
        ({"mm": 85.0, "film": 85, "note": b"."}, 1.0, True),
        ({"mm": 85.0, "film": 85, "note": b".", "taken": _NOON, "changed": _NOON}, 1.0, True),
        ({"mm": 85.0, "film": 85, "note": b".", "taken": _NOON, "changed": _LATER}, 1.0, False),
        ({"mm": 85.0, "film": 85, "note": b".", "camera_w": 6000, "camera_h": 4000}, None, True),
        ({**PLANE_OF_ALPHA, "software": "any name"}, None, False),
    ],
)
def test_a_focal_length_is_known_by_two_witnesses_and_an_estimate_by_one(tags, thumbnail, is_known):
    camera, notes = read(tags, (6000, 4000), thumbnail)
    assert camera.fx == pytest.approx(85 / 35.6 * 6000, rel=0.02)
    assert camera.known == is_known
    assert camera.focal_sigma == (None if is_known else 0.1)
    assert ["one EXIF tag" in note for note in notes] == [True] * (not is_known)


@pytest.mark.parametrize(
    ("tags", "size", "thumbnail", "word"),
    [
        ({}, (2164, 1443), None, "no camera writes"),
        ({}, (3000, 2250), None, "no camera writes"),
        ({}, (3024, 2268), 0.75, "thumbnail shows more"),
        ({"file_w": 4032, "file_h": 3024}, (3024, 2268), None, "4032 x 3024"),
        ({"camera_w": 4032, "camera_h": 3024}, (3024, 2268), None, "4032 x 3024"),
    ],
)
def test_a_crop_whose_tags_were_rewritten_has_no_focal_length(tags, size, thumbnail, word):
    written = {"mm": 4.2, "film": 26, "w": size[0], "h": size[1]}
    camera, (note,) = read(written | tags, size, thumbnail)
    assert camera is None
    assert word in note


def test_the_thumbnail_of_a_reduced_photo_says_that_it_is_whole():
    camera, _ = read({"mm": 4.2, "film": 26, "note": b"."}, (1000, 750), 1.0)
    assert camera.known
    assert camera.fx == pytest.approx(26 / 43.27 * 1250, rel=1e-3)


PLANE = {"mm": 14.0, "w": 4608, "h": 3456, "plane_x": 2663.6, "plane_y": 2663.6, "unit": _CM}
ZOOMED = {  # tags, and the true focal length of a photo 4608 px wide
    "a lens and its plane": (PLANE, 7458),
    "the equivalent of the lens": ({**PLANE, "film": 28}, 7458),
    "the equivalent of the zoomed photo": ({**PLANE, "film": 56}, 7458),
    "an equivalent whose sensor would be 2.8 mm wide": ({"mm": 4.2, "film": 52}, 6922),
}


@pytest.mark.parametrize("name", ZOOMED)
def test_the_focal_length_is_that_of_the_zoomed_photo_with_a_note(name):
    tags, focal = ZOOMED[name]
    camera, notes = read({**tags, "zoom": 2.0}, (4608, 3456))
    assert camera.fx == pytest.approx(focal, rel=0.03)
    assert camera.known == ("film" in tags and "plane_x" in tags)
    assert "zoom of 2" in notes[0]


def test_an_equivalent_that_may_have_the_digital_zoom_is_not_known():
    tags = {"mm": 6.77, "film": 48, "zoom": 2.0}
    camera, notes = read(tags, (4032, 3024))
    assert camera is None
    assert "it is not known whether" in notes[0]
    camera, _ = read({**tags, "make": "Apple"}, (4032, 3024))
    assert camera.fx == pytest.approx(48 / 43.27 * np.hypot(4032, 3024), rel=1e-3)


@pytest.mark.parametrize("zoom", [0.0, 1.0, float("nan")])
def test_a_zoom_that_was_not_used_changes_nothing(zoom):
    assert read({**PLANE, "zoom": zoom}, (4608, 3456)) == read(PLANE, (4608, 3456))


@pytest.mark.parametrize(
    ("tags", "notes"),
    [
        ({"film": 26, "w": 4000, "h": 3000}, ["4000 x 3000 px"]),
        ({"film": 4000}, ["not plausible"]),
        ({"film": 0}, []),
        ({"mm": 0.0, "plane_x": 100.0}, []),
        ({"mm": 50.0}, []),
        ({"mm": 50.0, "plane_x": 100.0, "unit": 9}, []),
    ],
)
def test_a_focal_length_that_is_ignored_has_a_note_and_one_that_lacks_has_none(tags, notes):
    camera, found = read(tags, (96, 72))
    assert camera is None
    assert [word in note for word, note in zip(notes, found, strict=True)] == [True] * len(notes)
