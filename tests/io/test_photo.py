"""Photos in: every kind of file ends in an upright RGB image with notes, or in a message that names
the fault.
"""

from __future__ import annotations

import errno
import io
import math
import os
import socket
import struct
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from physic_core.errors import ConfigError, InputError
from physic_core.io import photo as photo_module
from physic_core.io.photo import Photo, check_image, limit_size, read_photo
from physic_core.io.result_folder import file_digest
from physic_core.types import Intrinsics

WIDTH = 96
HEIGHT = 72


def corners(width=WIDTH, height=HEIGHT):
    """Red top left, green top right, blue bottom left, white bottom right."""
    image = np.zeros((height, width, 3), np.uint8)
    image[: height // 2, : width // 2, 0] = 255
    image[: height // 2, width // 2 :, 1] = 255
    image[height // 2 :, : width // 2, 2] = 255
    image[height // 2 :, width // 2 :] = 255
    return image


def saved(picture, path, **options):
    Image.fromarray(picture).save(path, **options)
    return path


def message_of(path):
    with pytest.raises(InputError) as caught:
        read_photo(path)
    return str(caught.value)


# --- what is refused
# ----------------------------------------------------------------------------------------------

NOISE = np.random.default_rng(0).integers(0, 255, (200, 300, 3), np.uint8)


def truncated(path):
    whole = saved(NOISE, path).read_bytes()
    path.write_bytes(whole[: len(whole) * 6 // 10])


def sparse(path):
    os.truncate(saved(NOISE, path), 400_000_001)


HUGE = 2 * (60_000).to_bytes(2, "little")
STARTS = {
    "page.jpg": (b"<!DOCTYPE html>", "page of the web"),
    "new.jxl": (b"\xff\x0a\x00", "JPEG XL"),
    "live.livp": (b"PK\x03\x04\x14", "LIVP"),
    "film.jpg": (b"\x00\x00\x00\x18ftypmp42", "a video"),
    "start.jpg": (b"\xff\xd8", "not an image"),
    "cr3.jpg": (b"\0\0\0\x18ftypcrx \0\0\0\1crx isom", "raw file"),
    "cr2.jpg": (b"II*\0\x10\0\0\0CR\2\0", "raw file"),
    "crw.jpg": (b"II\x1a\0\0\0HEAPCCDR", "raw file"),
    "raf.jpg": (b"FUJIFILMCCD-RAW 0201", "raw file"),
    "orf.jpg": (b"IIRO\x08\0\0\0", "raw file"),
    "rw2.jpg": (b"IIU\0\x18\0\0\0", "raw file"),
}
REFUSED = {
    "missing.jpg": (lambda path: None, "no such file"),
    "folder.jpg": (Path.mkdir, "it is a folder"),
    "pipe.jpg": (os.mkfifo, "not a regular file"),
    "empty.jpg": (Path.touch, "empty"),
    "postscript.jpg": (lambda path: saved(corners(), path, format="EPS"), "give a JPEG, PNG"),
    "sparse.jpg": (sparse, "damaged or truncated"),
    "cut.png": (truncated, "damaged or truncated"),
    "tiny.png": (lambda path: saved(corners(8, 8), path), "8 x 8 px"),
    "huge.gif": (
        lambda path: path.write_bytes(b"GIF89a%b\0\0\0,\0\0\0\0%b" % (HUGE, HUGE) + bytes(9)),
        "150 megapixels",
    ),
    "counts.tiff": (
        lambda path: saved(np.full((HEIGHT, WIDTH), 1 << 20, np.int32), path),
        "32 bits",
    ),
    "floats.tiff": (
        lambda path: cv2.imwrite(str(path), np.ones((HEIGHT, WIDTH, 3), np.float32)),
        "floating point in several channels; save it with 8 bits",
    ),
    **{
        name: (lambda path, start=start: path.write_bytes(start), reason)
        for name, (start, reason) in STARTS.items()
    },
    "sony.arw": (
        lambda path: saved(np.zeros((HEIGHT, WIDTH, 3), np.uint8), path, format="TIFF"),
        "develop it first",
    ),
    "raw.dng.tif": (
        lambda path: saved(np.zeros((HEIGHT, WIDTH, 3), np.uint8), path, tiffinfo={254: 1}),
        "develop",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_unusable_file_is_refused_with_its_path_and_the_reason(name, tmp_path):
    make, reason = REFUSED[name]
    make(tmp_path / name)
    message = message_of(tmp_path / name)
    assert str(tmp_path / name) in message
    assert reason in message


def test_a_photo_without_read_permission_is_refused(tmp_path, monkeypatch):
    def refuse(*_):  # root may read everything, so that a mode of 0 would not do
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    path = saved(corners(), tmp_path / "mine.png")
    monkeypatch.setattr(os, "open", refuse)
    assert "Permission denied" in message_of(path)


def test_a_socket_is_refused_without_waiting(tmp_path):
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(os.path.relpath(tmp_path / "socket"))  # an absolute path may be too long
        assert "not a regular file" in message_of(tmp_path / "socket")


def test_a_pipe_that_takes_the_place_of_a_file_is_refused_without_waiting(tmp_path, monkeypatch):
    path = tmp_path / "photo.png"
    path.write_bytes(b"a file")
    status = path.stat()
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(Path, "stat", lambda self: status)
    assert "not a regular file" in message_of(path)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("a\nb.jpg", r"a\nb.jpg"),
        ("caf\udce9.jpg", r"caf\udce9.jpg"),
        ("\u202egpj.exe", r"\u202egpj.exe"),
        ("Übung 写真.jpg", "Übung 写真.jpg"),
    ],
)
def test_names_cannot_change_a_message(name, shown, tmp_path):
    assert f"{tmp_path}/{shown}: " in message_of(tmp_path / name)
    Image.fromarray(corners()).save(os.fsencode(tmp_path / name), "PNG")
    assert read_photo(tmp_path / name).image.shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize(
    ("path", "shown"), [("a\0b.jpg", r"a\x00b.jpg"), ("\ud800.jpg", r"\ud800.jpg")]
)
def test_a_path_that_no_file_can_have_is_refused(path, shown):
    assert f"{shown}: the path has characters" in message_of(path)


JPEG_KINDS = [
    {},
    {"progressive": True},
    {"restart_marker_blocks": 5},
]


def jpeg(path, **options):
    """A JPEG of a picture with plains, edges and noise; its file's content."""
    image = np.zeros((120, 200, 3), np.uint8)
    image[:60, :100] = NOISE[:60, :100]
    image[60:, :, 1] = np.linspace(0, 255, 200)
    return saved(image, path, **options).read_bytes()


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
    assert ["last bytes are missing" in note for note in photo.notes] == [True]
    assert expected.notes == ()


def test_a_heic_file_without_its_package_names_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    path = tmp_path / "IMG_0001.HEIC"
    path.write_bytes(b"\x00\x00\x00\x18ftypheic\x00\x00\x00\x00mif1heic" + bytes(64))
    assert "pip install pi-heif" in message_of(path)


# --- what is converted
# --------------------------------------------------------------------------------------------

GREY = corners()[..., 0] // 2
DEEP = np.linspace(0, 65535, HEIGHT * WIDTH).round().astype(np.uint16).reshape(HEIGHT, WIDTH)
HIDDEN = np.where(np.arange(WIDTH) < 48, 0, 255)[None, :, None].repeat(HEIGHT, 0).astype(np.uint8)
CONVERTED = {
    **{
        f"plain.{suffix}": (Image.fromarray(corners()), corners(), ())
        for suffix in ("png", "webp", "bmp", "tiff", "gif")
    },
    "palette.png": (
        Image.fromarray(corners()).convert("P", palette=Image.Palette.ADAPTIVE, colors=4),
        corners(),
        (),
    ),
    "opaque.png": (Image.fromarray(corners()).convert("RGBA"), corners(), ()),
    "print.jpg": (Image.fromarray(corners()).convert("CMYK"), corners(), ("CMYK",)),
    "grey.png": (Image.fromarray(GREY), np.repeat(GREY[..., None], 3, -1), ("gray",)),
    "fax.png": (Image.fromarray(GREY > 0), np.repeat(corners()[..., :1], 3, -1), ("gray",)),
    "deep.png": (
        Image.fromarray(DEEP),
        np.repeat(DEEP[..., None] / 257, 3, -1),
        ("16 bits", "gray"),
    ),
    "cutout.png": (
        Image.fromarray(np.concatenate([corners(), HIDDEN], -1)),
        np.where(HIDDEN == 0, 128, corners()),
        ("transparent",),
    ),
}


@pytest.mark.parametrize("name", CONVERTED)
def test_every_kind_of_pixels_becomes_rgb_with_a_note_for_each_change(name, tmp_path):
    picture, expected, notes = CONVERTED[name]
    picture.save(tmp_path / name, **({"lossless": True} if name.endswith("webp") else {}))
    photo = read_photo(tmp_path / name)
    difference = np.abs(photo.image.astype(float) - expected)
    assert difference.mean() < 8 if name == "print.jpg" else difference.max() <= 0.5 + 1e-9
    assert (photo.image.dtype, photo.image.flags.writeable, photo.image.flags.c_contiguous) == (
        np.uint8,
        True,
        True,
    )
    assert len(photo.notes) == len(notes)
    assert all(word in note for word, note in zip(notes, photo.notes, strict=True))
    assert (photo.intrinsics, photo.file_size) == (None, None)
    assert photo.digest == file_digest(tmp_path / name)


TURNS = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.transpose(1, 0, 2),
    6: lambda a: np.rot90(a, 1),
    7: lambda a: a[::-1, ::-1].transpose(1, 0, 2),
    8: lambda a: np.rot90(a, -1),
}


@pytest.mark.parametrize("orientation", TURNS)
def test_a_turned_photo_comes_upright(stored, orientation):
    turned = Image.fromarray(np.ascontiguousarray(TURNS[orientation](corners())))
    photo = read_photo(stored("PNG", turned, exif={0x0112: orientation}))
    np.testing.assert_array_equal(photo.image, corners())
    assert ["upright" in note for note in photo.notes] == [True] * (orientation != 1)


@pytest.mark.slow
def test_eighty_megapixels_are_read_at_half_size(tmp_path):
    photo = read_photo(saved(corners(10_000, 8_000), tmp_path / "large.jpg", quality=50))
    assert photo.image.shape == (4000, 5000, 3)
    assert "80 megapixels were read at 5000 x 4000 px" in photo.notes
    assert photo.file_size == (10_000, 8_000)
    assert np.abs(photo.image[::40, ::40].astype(int) - corners(125, 100)).mean() < 2


def test_a_photo_that_is_replaced_has_the_digest_of_the_pixels_that_were_read(
    tmp_path, monkeypatch
):
    path, other = (
        saved(np.full((64, 64, 3), v, np.uint8), tmp_path / f"{v}.png") for v in (10, 200)
    )
    expected = file_digest(path)
    read = photo_module._read_pixels

    def replace_then_read(*arguments):
        os.replace(other, path)
        return read(*arguments)

    monkeypatch.setattr(photo_module, "_read_pixels", replace_then_read)
    found = read_photo(path)
    assert (found.image.max(), found.digest) == (10, expected)


# --- what the file says about the camera
# --------------------------------------------------------------------------


def test_the_35_mm_equivalent_is_read_by_the_diagonal(stored):
    photo = read_photo(stored("JPEG", exif={0xA405: 26}))
    focal = 26 * math.hypot(WIDTH, HEIGHT) / math.hypot(36, 24)
    expected = Intrinsics.from_focal(
        focal, WIDTH, HEIGHT, "EXIF: 26 mm (35 mm equivalent, by the diagonal)", "estimated"
    )
    assert photo.intrinsics == replace(expected, focal_sigma=0.1)
    assert ["cropped" in note for note in photo.notes] == [True]


def encoded(picture, has_jfif, **options):
    stream = io.BytesIO()
    picture.save(stream, "JPEG", quality=95, **options)
    data = stream.getvalue()
    return data if has_jfif else data[:2] + data[20:]


def with_thumbnail(picture, thumbnail, jfif=()):
    """A JPEG of 26 mm (35 mm equivalent) with a maker note and a thumbnail, as cameras write it."""
    data = encoded(thumbnail, "thumbnail" in jfif)
    # 8: first directory, with that of Exif; 26: the latter; 56: that of the thumbnail; 86: its data
    first = struct.pack("<HHHIII", 1, 0x8769, 4, 1, 26, 56)
    exif = struct.pack("<HHHIIHHIII", 2, 0x927C, 7, 4, 0, 0xA405, 3, 1, 26, 0)
    place = struct.pack("<HHHIIHHIII", 2, 0x0201, 4, 1, 86, 0x0202, 4, 1, len(data), 0)
    blob = b"Exif\0\0" + b"II*\0\x08\0\0\0" + first + exif + place + data
    return read_photo(encoded(picture, "file" in jfif, exif=blob))


def noise(width, height):
    random = np.random.default_rng(1).integers(0, 256, (12, 16, 3), np.uint8)
    return Image.fromarray(random).resize((width, height), Image.Resampling.BICUBIC)


@pytest.mark.parametrize(
    ("box", "bars", "word"),
    [
        ((0, 0, 640, 480), 0, ""),
        ((0, 0, 640, 480), 12, ""),
        ((80, 60, 560, 420), 0, "thumbnail shows more"),
    ],
)
def test_a_thumbnail_tells_the_whole_photo_from_a_crop(box, bars, word):
    whole = noise(640, 480)
    thumbnail = Image.new("RGB", (160, 120 + 2 * bars))
    thumbnail.paste(whole.resize((160, 120)), (0, bars))
    photo = with_thumbnail(whole.crop(box), thumbnail)
    assert (photo.intrinsics is None) == bool(word)
    if photo.intrinsics is None:
        assert word in " ".join(photo.notes)
    else:
        assert photo.intrinsics.known


@pytest.mark.parametrize("encoded_anew", ["file", "thumbnail"])
def test_a_thumbnail_that_a_program_may_have_made_is_no_witness(encoded_anew):
    photo = with_thumbnail(noise(640, 480), noise(160, 120), {encoded_anew})
    assert not photo.intrinsics.known


def test_a_turned_photo_swaps_the_focal_lengths(stored):
    plane = {0x920A: 50.0, 0xA20E: 400.0, 0xA20F: 440.0, 0xA210: 3}  # px a centimetre
    size = {0xA002: 1800, 0xA003: 1200}
    picture = Image.fromarray(corners(1800, 1200))
    intrinsics = read_photo(stored("JPEG", picture, exif={0x0112: 6} | plane | size)).intrinsics
    assert (intrinsics.width, intrinsics.height) == (1200, 1800)
    assert (intrinsics.fx, intrinsics.fy) == pytest.approx((2200, 2000), rel=1e-6)


@pytest.mark.parametrize(("size", "shape"), [(1 << 20, (HEIGHT, WIDTH)), (1, (WIDTH, HEIGHT))])
def test_exif_data_of_more_than_1_mb_are_not_read(size, shape, tmp_path):
    tags = Image.Exif()
    tags[0x0112] = 6
    path = tmp_path / "a.png"
    Image.fromarray(corners()).save(path, exif=tags.tobytes() + bytes(size))
    photo = read_photo(path)
    assert photo.image.shape[:2] == shape
    assert any("1 MB" in note for note in photo.notes) == (size > 1)


def test_a_broken_exif_block_only_loses_the_camera(tmp_path):
    path = tmp_path / "a.jpg"
    Image.fromarray(corners()).save(path, exif=b"Exif\x00\x00II*\x00\xff\xff\xff\xff garbage")
    photo = read_photo(path)
    assert photo.image.shape == (HEIGHT, WIDTH, 3)
    assert photo.intrinsics is None


# --- resizing
# --------------------------------------------------------------------------------------------------


def test_an_image_of_extreme_aspect_is_refused():
    with pytest.raises(InputError, match="1000 x 40 px"):
        limit_size(Photo(np.zeros((80, 2000, 3), np.uint8)), 1000)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        (Intrinsics.from_focal(1e7, 200, 100), "focal length is 5e"),
        (Intrinsics(200.0, 200.0, 199.6, 49.5, 200, 100), "principal point .199.6"),
        (Intrinsics.from_focal(400.0, 400, 200), "400 x 200 px"),
    ],
)
def test_a_camera_that_cannot_be_the_photos_is_refused(camera, words):
    with pytest.raises(ConfigError, match=words):
        limit_size(Photo(np.zeros((100, 200, 3), np.uint8), camera), 128)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (3.5, "got float"),
        (np.zeros((72, 96)), "got float64"),
        (np.zeros((2, 72, 96, 3), np.uint8), "got .2, 72, 96, 3"),
        (np.zeros((3, 72, 96), np.uint8), "channels last"),
        (np.zeros((8, 8, 3), np.uint8), "8 x 8 px"),
    ],
)
def test_a_bad_array_is_refused(image, words):
    with pytest.raises(InputError, match=words):
        check_image(image)


def test_a_pil_image_of_too_many_pixels_is_refused_before_it_is_decoded(monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", None)  # as by a program that lifts the limit
    with (
        Image.open(io.BytesIO(b"P5 20000 10000 255\n")) as image,
        pytest.raises(InputError, match="more than 150 megapixels"),
    ):
        read_photo(image)
