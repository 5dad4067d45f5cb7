"""Photos and masks of people: an image, or InputError with the path, and no word of a decoder on
the terminal.
"""

from __future__ import annotations

import io
import os
import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, features

from fuzzing import lost_data
from fuzzing.target import Target
from physic_core.errors import InputError
from physic_core.io.photo import MIN_SIDE, read_photo

WIDTH = 72
HEIGHT = 65
MAX_WRONG_SHARE = 0.005


@cache
def encoded() -> list[bytes]:
    """The same picture in every format, mode and compression that Pillow can write and read_photo
    may read.
    """
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rgb = Image.fromarray(np.stack([3 * x, 3 * y, (x * y) % 256], -1).astype(np.uint8))
    rgba = rgb.copy()
    rgba.putalpha(Image.fromarray((2 * x + y).astype(np.uint8)))
    deep = Image.fromarray((900 * x).astype(np.uint16))
    exif = Image.Exif()
    exif[0x0112] = 6
    exif.get_ifd(0x8769).update({0x920A: 4.2, 0xA405: 26})
    kinds: list[tuple[Image.Image, str, dict]] = [
        (rgb, "JPEG", {"exif": exif}),
        (rgb, "JPEG", {"progressive": True, "icc_profile": bytes(300), "comment": b"c"}),
        (rgb.convert("CMYK"), "JPEG", {}),
        (rgb, "MPO", {"save_all": True, "append_images": [rgb]}),
        (rgb, "PNG", {"exif": exif}),
        (rgba, "PNG", {}),
        (deep, "PNG", {}),
        (rgb.quantize(9), "PNG", {"transparency": 3}),
        (rgb, "PNG", {"save_all": True, "append_images": [rgb.rotate(90)]}),
        (rgb, "GIF", {"save_all": True, "append_images": [rgb.rotate(90), rgb]}),
        (rgb, "BMP", {}),
        (rgb, "PPM", {}),
        (rgb, "TIFF", {"exif": exif}),
        (rgb, "TIFF", {"compression": "tiff_lzw"}),
        (rgb, "TIFF", {"compression": "jpeg"}),
        (rgba, "TIFF", {"compression": "tiff_adobe_deflate"}),
        (deep, "TIFF", {"compression": "packbits"}),
        (rgb.convert("1"), "TIFF", {"compression": "group4"}),
        (rgb, "TIFF", {"big_tiff": True, "save_all": True, "append_images": [rgba, deep]}),
        (rgb, "WEBP", {"exif": exif, "quality": 50}),
        (rgba, "WEBP", {"lossless": True}),
        (rgb, "WEBP", {"save_all": True, "append_images": [rgba]}),
    ]
    if features.check("jpg_2000"):
        kinds += [(rgb, "JPEG2000", {}), (rgba, "JPEG2000", {"tile_size": (32, 32)})]
    if features.check("avif"):
        kinds += [
            (rgb, "AVIF", {"exif": exif, "speed": 10}),
            (rgba, "AVIF", {"save_all": True, "append_images": [rgba.rotate(90)], "speed": 10}),
        ]
    seeds = []
    for image, kind, options in kinds:
        file = io.BytesIO()
        image.save(file, kind, **options)
        seeds.append(file.getvalue())
    return seeds


def make_seeds(folder: Path) -> list[bytes]:
    return encoded()


@contextmanager
def silent(folder: Path) -> Iterator[None]:
    """Require that nothing is written to the terminal, by C code neither."""
    terminal = os.dup(2)
    with (folder / "stderr").open("w+b") as written:
        os.dup2(written.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)
        written.seek(0)
        assert written.read() == b""


def attack(data: bytes, folder: Path) -> None:
    path = folder / "photo"
    path.write_bytes(data)
    with silent(folder):
        photo = refused(path, read_photo)
    if photo is not None:
        assert photo.image.dtype == np.uint8
        assert photo.image.shape[2] == 3
        assert min(photo.image.shape[:2]) >= MIN_SIDE
        assert all(note.isprintable() for note in photo.notes)


def refused(path: Path, read: Callable[[Path], Any]) -> Any:
    """Return what is read, or None if the file is refused with a message that names it."""
    try:
        return read(path)
    except InputError as error:
        if str(path) not in str(error):
            raise AssertionError(f"the message does not name the file: {error}") from error
    return None


def make_twins(folder: Path) -> list[bytes]:
    """The first line names the undamaged twin."""
    return [kind.encode() + b"\n" + lost_data.encoded(kind) for kind in lost_data.KINDS]


def lose_data(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    kind = data.partition(b"\n")[0]
    return kind + b"\n" + lost_data.damaged(kind.decode(), rng)


def attack_twin(data: bytes, folder: Path) -> None:
    """What is read differs from the undamaged photo in few pixels, which a progressive JPEG's
    finest details are.
    """
    kind, _, content = data.partition(b"\n")
    path = folder / "photo"
    path.write_bytes(content)
    if (photo := refused(path, read_photo)) is not None:
        share = lost_data.wrong_share(kind.decode(), photo.image)
        assert share <= MAX_WRONG_SHARE, f"{share:.2%} of the pixels are wrong"


TARGETS = [
    Target("photos", make_seeds, attack),
    Target("photos-lost-data", make_twins, attack_twin, lose_data),
]
