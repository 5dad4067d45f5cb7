"""Damaged files: every reader gives what was written, or refuses the file with its own error."""

from __future__ import annotations

import io
import pickle
import random
import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, features

from physic_core.body.files import MANO, load_smplx, read_model_file
from physic_core.errors import BackendError, BodyModelError, InputError
from physic_core.files.plain import DamagedFileError, read_value, write_value
from physic_core.io.photo import MIN_SIDE, read_photo
from physic_core.io.results import load_people, load_reconstruction, save_reconstruction
from physic_core.types import DepthMap, Intrinsics
from physic_core.weights.manifest import is_inside, read_manifest
from tiny_result import tiny_result

CASES = 60
"""Damaged files of each reader."""
CORPUS = Path(__file__).parent / "corpus"
EXTREMES = (0x00, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
"""Numbers at which the arithmetic of decoders overflows."""
TOKENS = (
    *(
        "0",
        "-1",
        "1e309",
        "nan",
        "Infinity",
        "9" * 5000,
        "true",
        "null",
        '""',
        "[]",
        "{}",
        "[" * 2000,
    ),
    *(
        '"\\ud800"',
        '"é\U0001f600"',
        '"/dev/zero"',
        "\x00",
        "'",
        "=",
        "\n",
        "[[a]]",
        "1979-05-27T07:32:00Z",
    ),
)
"""Tokens of TOML and JSON that parsers and checks of values have failed on."""


def damaged_bytes(data, rng):
    """Return the data with one to three changes, every second in the first 256 bytes."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        at = rng.randrange(max(1, len(out) if rng.random() < 0.5 else min(len(out), 256)))
        size = rng.choice((1, 2, 4, 16, 256))
        number = rng.choice(EXTREMES).to_bytes(4, rng.choice(("little", "big")))
        changes = (
            (at, at + 1, bytes([out[at] ^ 1 << rng.randrange(8)]) if out else b"\x00"),
            (at, at + 4, number),
            (at, len(out), b""),
            (at, at + size, b""),
            (at, at, rng.randbytes(size)),
            (at, at, out[at : at + size]),
        )
        start, end, new = rng.choice(changes)
        out[start:end] = new
    return bytes(out)


def damaged_text(data, rng):
    """Return the text with another token in place of one, without it, or with it many times."""
    text = data.decode()
    spans = [
        match.span()
        for match in re.finditer(r"\"[^\"\n]*\"|[A-Za-z_]+|-?\d+(?:\.\d+)?|[\[\]{}=:,]", text)
    ]
    start, end = rng.choice(spans)
    new = rng.choice((*TOKENS, "", text[start:end] * 50))
    return (text[:start] + new + text[end:]).encode("utf-8", "backslashreplace")


@cache
def photos():
    """Return one picture in the formats that Pillow can write and that are read."""
    x, y = np.meshgrid(np.arange(72), np.arange(65))
    rgb = Image.fromarray(np.stack([3 * x, 3 * y, (x * y) % 256], -1).astype(np.uint8))
    deep = Image.fromarray((900 * x).astype(np.uint16))
    exif = Image.Exif()
    exif[0x0112] = 6
    kinds: list[tuple[Image.Image, str, dict]] = [
        (rgb, "JPEG", {"exif": exif}),
        (rgb.convert("CMYK"), "JPEG", {"progressive": True, "icc_profile": bytes(300)}),
        (rgb, "MPO", {"save_all": True, "append_images": [rgb]}),
        (rgb, "PNG", {"exif": exif}),
        (deep, "PNG", {}),
        (rgb.quantize(9), "PNG", {"transparency": 3}),
        (rgb, "GIF", {"save_all": True, "append_images": [rgb.rotate(90)]}),
        (rgb, "BMP", {}),
        (rgb, "PPM", {}),
        (rgb, "TIFF", {"compression": "tiff_lzw", "exif": exif}),
        (rgb.convert("1"), "TIFF", {"compression": "group4"}),
        (rgb, "WEBP", {"exif": exif, "quality": 50}),
    ]
    if features.check("jpg_2000"):
        kinds.append((rgb, "JPEG2000", {}))
    if features.check("avif"):
        kinds.append((rgb, "AVIF", {"speed": 10}))
    files = []
    for image, kind, options in kinds:
        file = io.BytesIO()
        image.save(file, kind, **options)
        files.append(file.getvalue())
    return tuple(files)


def opened(read, path, error):
    """Return what a reader returns; None if its refusal is printable and names the file."""
    try:
        return read()
    except error as refusal:
        message = str(refusal)
    assert str(path) in message
    assert len(message) < 1500 + len(str(path))
    assert message.isprintable()
    return None


def open_photo(data, folder):
    path = folder / "photo"
    path.write_bytes(data)
    photo = opened(lambda: read_photo(path), path, InputError)
    if photo is not None:
        assert photo.image.dtype == np.uint8
        assert min(photo.image.shape[:2]) >= MIN_SIDE
        assert all(note.isprintable() for note in photo.notes)


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Files of a saved result, by what is saved."""
    files = {}
    for save in ("numbers", "people"):
        folder = tmp_path_factory.mktemp(save)
        save_reconstruction(tiny_result(0), folder, save)
        files[save] = {
            name: (folder / f"reconstruction.{name}").read_bytes() for name in ("json", "npz")
        }
    return files


def open_result(files, folder, load=load_reconstruction):
    for name, content in files.items():
        (folder / f"reconstruction.{name}").write_bytes(content)
    opened(lambda: load(folder), folder, InputError)


VALUE = DepthMap(
    np.arange(15, dtype=np.float32).reshape(5, 3),
    Intrinsics.from_focal(3, 3, 5, "é"),
    0.5,
    ("a", "NaN"),
)


def open_cached(data, folder):
    (folder / "a.npz").write_bytes(data)
    try:
        found = read_value(folder / "a.npz", [DepthMap])
    except DamagedFileError:
        return
    assert repr(found) == repr(VALUE)
    np.testing.assert_array_equal(found.depth, VALUE.depth)


@cache
def hands():
    """Return a made-up model of MANO as pickles of two protocols and as an archive."""
    rng = np.random.default_rng(0)
    parents = [2**32 - 1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14]
    arrays = {
        "f": rng.integers(0, 778, (1538, 3)).astype(np.uint16),
        "kintree_table": np.array([parents, range(16)], np.uint32),
        "hands_components": np.eye(45, dtype=np.float16),
        "hands_mean": np.zeros(45, np.float16),
        "v_template": np.zeros((778, 3), np.float16),
        "shapedirs": np.zeros((778, 3, 10), np.float16),
        "J_regressor": np.eye(16, 778, dtype=np.float16),
        "weights": np.zeros((778, 16), np.float16),
        "posedirs": np.zeros((778, 3, 135), np.float16),
    }
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return pickle.dumps(arrays, 2), pickle.dumps(arrays, 5), file.getvalue()


def open_hand(data, folder):
    path = folder / "MANO_RIGHT.pkl"
    path.write_bytes(data)
    arrays = opened(lambda: read_model_file(path, MANO), path, BodyModelError)
    for name, shape in MANO.shapes.items() if arrays is not None else ():
        assert all(
            wanted in (None, size) for wanted, size in zip(shape, arrays[name].shape, strict=True)
        )
        assert np.isfinite(arrays[name]).all()


MANIFEST = b"""
[net-1]
summary = "A network"
license = "MIT"
commercial = true
account = false
homepage = "https://example.org/net"
advice = "export it"
[[net-1.files]]
path = "model.onnx"
bytes = 140852051
sha256 = "0000000000000000000000000000000000000000000000000000000000000007"
source = "hf://owner/net/model.onnx@main"
[[net-1.files]]
path = "deep/data.bin"
source = "https://example.org/net.zip#inside/data.bin"

["other.net"]
summary = "Another"
license = "CC BY-NC 4.0"
commercial = false
files = [{ path = "a.npz", bytes = 12 }]
advice = "copy it"
"""


def open_manifest(data, folder):
    path = folder / "weights.toml"
    path.write_bytes(data)
    try:
        sets = read_manifest(path)
    except BackendError:
        return
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    assert list(sets) == list(tables)
    for name, weights in sets.items():
        stated = [
            (row["path"], row.get("bytes"), row.get("sha256")) for row in tables[name]["files"]
        ]
        assert [(file.path, file.bytes, file.sha256) for file in weights.files] == stated
        assert (weights.license, weights.commercial) == (
            tables[name]["license"],
            tables[name].get("commercial"),
        )
        assert all(is_inside(file.path) for file in weights.files)


def damaged(whole, damage, folder):
    """Yield the whole file and damaged ones, each with an empty folder."""
    for case in range(CASES + 1):
        (folder / str(case)).mkdir(parents=True)
        yield damage(whole, random.Random(case)) if case else whole, folder / str(case)


@pytest.mark.parametrize("number", range(len(photos())))
def test_a_damaged_photo_is_read_or_refused(number, tmp_path):
    for data, folder in damaged(photos()[number], damaged_bytes, tmp_path):
        open_photo(data, folder)


def test_a_damaged_result_is_read_or_refused(saved, tmp_path):
    numbers, people = saved["numbers"], saved["people"]
    for data, folder in damaged(numbers["npz"], damaged_bytes, tmp_path / "arrays"):
        open_result(numbers | {"npz": data}, folder)
    # The list of members is at the end.
    for data, folder in damaged(numbers["npz"][::-1], damaged_bytes, tmp_path / "members"):
        open_result(numbers | {"npz": data[::-1]}, folder)
    for data, folder in damaged(numbers["json"], damaged_text, tmp_path / "document"):
        open_result(numbers | {"json": data}, folder)
    for data, folder in damaged(people["npz"], damaged_bytes, tmp_path / "people"):
        open_result(people | {"npz": data}, folder, load_people)


def test_a_damaged_value_of_the_cache_is_never_another_value(tmp_path):
    write_value(tmp_path / "value.npz", VALUE)
    for data, folder in damaged((tmp_path / "value.npz").read_bytes(), damaged_bytes, tmp_path):
        open_cached(data, folder)


@pytest.mark.parametrize("number", range(3))
def test_a_damaged_body_model_is_read_or_refused(number, tmp_path):
    for data, folder in damaged(hands()[number], damaged_bytes, tmp_path):
        open_hand(data, folder)


def test_a_damaged_list_of_weights_is_read_or_refused(tmp_path):
    for data, folder in damaged(MANIFEST, damaged_text, tmp_path):
        open_manifest(data, folder)


def test_files_that_once_broke_a_reader_are_refused(saved, tmp_path):
    open_result(saved["numbers"] | {"npz": (CORPUS / "long-header.npz").read_bytes()}, tmp_path)
    open_hand((CORPUS / "MANO_RIGHT.pkl").read_bytes(), tmp_path)
    for name in ("MANO_RIGHT.pkl", "SMPLX_NEUTRAL.npz"):
        (tmp_path / "SMPLX_NEUTRAL.npz").write_bytes((CORPUS / name).read_bytes())
        with pytest.raises(BodyModelError):
            load_smplx(tmp_path / "SMPLX_NEUTRAL.npz")
    open_manifest((CORPUS / "weights.toml").read_bytes(), tmp_path)
