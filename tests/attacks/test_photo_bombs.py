"""Images that promise far more than they have take little memory, and end in a message or a
note.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from photo_bombs import BOMBS, huge_tile
from physic_batch.journal import read_journals
from physic_testing.worlds import load_world

PEAK = """
import contextlib, resource, sys
from pathlib import Path
def peak():
    '''Peak resident memory, bytes. That of getrusage includes the parent's before exec.'''
    status = Path("/proc/self/status")
    if status.exists():
        return 1024 * int(status.read_text().split("VmHWM:")[1].split()[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
"""


@pytest.fixture
def lines_of(python):
    """A function that returns the lines which a new process prints; it writes nothing to stderr."""

    def run(code, paths):
        done = python(PEAK + code, *paths)
        assert done.stderr == ""
        return done.stdout.splitlines()

    return run


def test_no_image_takes_more_than_one_and_a_half_gigabytes(tmp_path, lines_of):
    for i, (make, _) in enumerate(BOMBS.values()):
        (tmp_path / str(i)).write_bytes(make())
    code = """
from physic_core.errors import InputError
from physic_core.io.photo import read_photo
for path in sys.argv[1:]:
    try:
        print("; ".join(read_photo(path).notes))
    except InputError as error:
        print(error)
print(peak())
"""
    *texts, peak = lines_of(code, [tmp_path / str(i) for i in range(len(BOMBS))])
    for (name, (_, expected)), text in zip(BOMBS.items(), texts, strict=True):
        assert expected in text, name
    assert float(peak) < 1.5e9


@pytest.mark.skipif(sys.platform != "linux", reason="workers are limited on Linux")
def test_a_worker_takes_no_more_memory_than_a_photo_needs(tmp_path):
    """A decoder may take more than the header of the image tells, such as a tile of 2 GB for an
    image of 64 px.
    """
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.tif").write_bytes(huge_tile())
    Image.fromarray(load_world("stand", size=(96, 72)).image).save(tmp_path / "photos" / "b.png")
    out = tmp_path / "out"
    # In a process of its own: the peak of a worker includes that of its parent before exec.
    command = [
        sys.executable,
        "-P",
        "-m",
        "physic_core",
        "batch",
        tmp_path / "photos",
        "-o",
        out,
        "--preset",
        "mock",
    ]
    command += ["--workers", "1", "--set", "engine.joint.optimiser.steps=1", "--save", "none"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.stdout.splitlines()[0] == "1 done, 1 failed (1 InputError)"
    (row,) = (row for row in read_journals(out).values() if row["state"] == "done")
    assert row["peak_mb"] < 2000


SIDE = 2000
KINDS = {
    "plain.jpeg": ("RGB", {}),
    "progressive.jpeg": ("CMYK", {"progressive": True, "subsampling": 0}),
    "plain.png": ("RGBA", {"compress_level": 1}),
    "plain.webp": ("RGBA", {"lossless": True, "quality": 0, "method": 0}),
    "plain.avif": ("RGBA", {"speed": 10}),
    "moving.avif": (
        "RGB",
        {"speed": 10, "save_all": True, "append_images": [Image.new("RGB", (SIDE, SIDE))]},
    ),
    "plain.jp2": ("RGBA", {}),
    "tiled.jp2": ("RGB", {"tile_size": (512, 512)}),
    "turned.tif": ("RGB", {"compression": "tiff_lzw", "tiffinfo": {0x0112: 6}}),
    "plain.gif": ("P", {}),
    "plain.bmp": ("RGB", {}),
}


def test_decoding_the_largest_image_of_each_format_takes_less_than_1_5_gb(tmp_path, lines_of):
    x = np.linspace(0, 255, SIDE).astype(np.uint8)[None].repeat(SIDE, 0)
    picture = Image.fromarray(np.stack([x, x[:, ::-1], x // 2], -1))
    for name, (mode, options) in KINDS.items():
        picture.convert(mode).save(tmp_path / name, **options)
    code = """
from physic_core.files.image_file import ImageSource, decode, max_pixels, open_image
for path in map(Path, sys.argv[1:]):
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    before = peak()
    source = ImageSource(path.name, path=path)
    with open_image(source) as (image, file):
        pixels, most = image.width * image.height, max_pixels(image.format)
        image.draft(image.mode, (image.width // 2, image.height // 2))  # as a JPEG of more than 24 megapixels is read
        decode(image, source)
        print(path.name, (peak() - before - 8e6) / pixels * most)  # a few MB are the decoders' own, whatever the size
    del image, file
"""  # noqa: E501
    for line in lines_of(code, [tmp_path / name for name in KINDS]):
        name, taken = line.split()
        assert float(taken) < 1.5e9, name
