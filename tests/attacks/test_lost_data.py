"""A photo whose file has lost data is refused, and never reconstructed from pixels that a decoder
has invented.
"""

from __future__ import annotations

import io
import threading
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFile, PngImagePlugin

from lost_data import BLOCK, KINDS, PHOTO, cut, encoded, picture_start, pixels, zeros
from physic_core.errors import InputError
from physic_core.files.image_file import MAX_SCANS
from physic_core.io.photo import read_photo

JPEGS = [kind for kind, (name, _) in KINDS.items() if name == "JPEG"]


def refuse(photo):
    with pytest.raises(InputError, match="its data are damaged or truncated"):
        read_photo(photo)


@pytest.mark.parametrize("kind", [*JPEGS, "png"])
def test_a_block_of_zeros_is_found(kind):
    whole = encoded(kind)
    begin = picture_start(whole)
    for share in (0.1, 0.5, 0.9):
        refuse(zeros(whole, begin + int(share * (len(whole) - begin - 5000))))


@pytest.mark.parametrize("kind", ["baseline", "fine", "optimised", "restarts", "grey"])
def test_a_short_block_of_zeros_is_found(kind):
    """The decoder alone misses a fifth of those in the fine one: the zeros stand for as many blocks
    as were there.
    """
    whole = encoded(kind)
    for at in range(picture_start(whole), len(whole) - 600, 997):
        refuse(whole[:at] + bytes(512) + whole[at + 512 :])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.9, 0.5, 0.1])
def test_a_cut_with_the_end_put_back_is_found(kind, share):
    whole = encoded(kind)
    refuse(cut(whole, int(share * len(whole))))


@pytest.mark.parametrize("kind", JPEGS)
def test_a_jpeg_that_is_cut_is_found(kind):
    whole = encoded(kind)
    for end in (*range(picture_start(whole), len(whole), len(whole) // 9), len(whole) - 9):
        refuse(whole[:end])


@pytest.mark.parametrize("kind", KINDS)
def test_of_a_photo_that_lacks_a_block_few_pixels_are_wrong(kind):
    """The finest details of a progressive JPEG may be missing."""
    whole = encoded(kind)
    begin = picture_start(whole)
    for share in (0.05, 0.35, 0.65, 0.95):
        at = begin + int(share * (len(whole) - begin - BLOCK - 20))
        try:
            photo = read_photo(whole[:at] + whole[at + BLOCK :])
        except InputError:
            continue
        difference = np.abs(photo.image.astype(np.int16) - pixels(kind))
        assert (difference.max(-1) > 40).mean() < 0.005


@pytest.mark.parametrize("kind", ["avif", "heic"])
def test_an_avif_or_heic_that_is_cut_is_found(kind):
    if kind == "heic":
        pytest.importorskip("pi_heif")
        whole = (Path(__file__).parent / "corpus" / "photo.heic").read_bytes()
    else:
        file = io.BytesIO()
        Image.open(PHOTO).convert("RGB").save(file, "AVIF", speed=9)
        whole = file.getvalue()
    assert read_photo(whole).image.any()
    for at in range(len(whole) // 5, len(whole), 997):
        refuse(whole[:at])


def test_a_damaged_pillow_image_is_refused():
    with Image.open(io.BytesIO(cut(encoded("baseline"), 20_000))) as image:
        refuse(image)


HARMLESS = {
    "bytes between segments": lambda data: data[:20] + b"\x00\x00\x00" + data[20:],
    "an unknown version of JFIF": lambda data: data.replace(
        b"JFIF\x00\x01\x01", b"JFIF\x00\x03\x01"
    ),
    "bytes after the picture": lambda data: data + bytes(5000) + b"\xff\xda" * 2 * MAX_SCANS,
    "padding before the end": lambda data: data[:-2] + bytes(32) + data[-2:],
    "zeros in the metadata": lambda data: data[:2] + b"\xff\xe5\x20\x02" + bytes(0x2000) + data[2:],
}


@pytest.mark.parametrize("change", HARMLESS)
@pytest.mark.parametrize("kind", JPEGS)
def test_oddities_of_cameras_are_no_damage(kind, change):
    data = HARMLESS[change](encoded(kind))
    assert data != encoded(kind)
    np.testing.assert_array_equal(read_photo(data).image, pixels(kind))


@pytest.mark.parametrize("mode", ["RGB", "CMYK"])
@pytest.mark.parametrize(
    "options", [{"optimize": True}, {"progressive": True, "quality": 5}], ids=str
)
def test_one_colour_is_no_damage(mode, options):
    """Large plain areas give long runs of zeros."""
    file = io.BytesIO()
    Image.new("RGB", (1600, 1200), "white").convert(mode).save(file, "JPEG", **options)
    assert np.ptp(read_photo(file.getvalue()).image) == 0


def scans(count):
    """A JPEG of three equal components, one in each scan, in ``count`` scans.

    It is the grey JPEG of one component.
    """
    file = io.BytesIO()
    with Image.open(PHOTO) as image:
        image.convert("L").resize((96, 64)).save(file, "JPEG")
    data = file.getvalue()
    frame = data.index(b"\xff\xc0")
    scan = data.index(b"\xff\xda")
    sizes = data[frame + 4 : frame + 9]
    components = b"".join(bytes((i, 0x11, 0)) for i in (1, 2, 3))
    codes = data[scan + 10 : -2]
    one = [b"\xff\xda\x00\x08\x01" + bytes((i, 0, 0, 63, 0)) + codes for i in (1, 2, 3)]
    header = (
        data[:frame] + b"\xff\xc0\x00\x11" + sizes + b"\x03" + components + data[frame + 13 : scan]
    )
    return header + b"".join(one[i % 3] for i in range(count)) + b"\xff\xd9"


def test_the_number_of_scans_is_bounded():
    np.testing.assert_array_equal(read_photo(scans(MAX_SCANS)).image, read_photo(scans(3)).image)
    refuse(scans(MAX_SCANS + 1))


SWITCHES = [(ImageFile, "LOAD_TRUNCATED_IMAGES", True), (Image, "MAX_IMAGE_PIXELS", 10),
            (Image, "MAX_IMAGE_PIXELS", None), (PngImagePlugin, "MAX_TEXT_CHUNK", 1)]  # fmt: skip


@pytest.mark.parametrize(("module", "name", "value"), SWITCHES, ids=lambda part: str(part)[:40])
@pytest.mark.parametrize("kind", ["baseline", "png"])
def test_switches_of_pillow_change_nothing(kind, module, name, value, monkeypatch):
    expected = pixels(kind)
    half = cut(encoded(kind), len(encoded(kind)) // 2)
    monkeypatch.setattr(module, name, value)
    np.testing.assert_array_equal(read_photo(encoded(kind)).image, expected)
    refuse(half)
    refuse(encoded(kind)[: len(encoded(kind)) // 2])
    assert getattr(module, name) == value


def test_a_damaged_photo_is_shown_to_no_decoder_of_another_format(monkeypatch):
    shown = []

    def accept(prefix):
        shown.append(prefix)
        return False

    data = encoded("png")[:8] + bytes(1000)
    monkeypatch.setattr(Image, "ID", ["OTHER", *Image.ID])
    monkeypatch.setitem(Image.OPEN, "OTHER", (ImageFile.ImageFile, accept))
    refuse(data)
    with pytest.raises(OSError, match="cannot identify"):
        Image.open(io.BytesIO(data))
    assert len(shown) == 1


def test_threads_find_damage_and_leave_the_switches_as_they_were(monkeypatch):
    monkeypatch.setattr(ImageFile, "LOAD_TRUNCATED_IMAGES", True)
    data = cut(encoded("png"), len(encoded("png")) // 2)
    found = []

    def read():
        for _ in range(10):
            refuse(data)
            found.append(data)

    threads = [threading.Thread(target=read) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 40
    assert ImageFile.LOAD_TRUNCATED_IMAGES is True
