"""Arrays of a file are as long as their headers say, or the file is refused."""

from __future__ import annotations

import io
import re
import warnings
import zipfile

import numpy as np
import pytest

from physic_core.files.npz import read_arrays, read_headers

pytestmark = pytest.mark.quick


def with_shape(shape):
    """A file whose header has another shape than the array (5, 3) in it; its checksums are
    right.
    """
    member = io.BytesIO()
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        member, {"descr": "<f4", "fortran_order": False, "shape": shape}
    )
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("points.npy", member.getvalue() + bytes(60))
    return file


def test_arrays_of_more_than_4_gb_are_refused_by_the_sizes_that_the_file_states():
    file = io.BytesIO()
    np.savez(file, a=np.zeros(3), b=np.zeros(3))
    content = bytearray(file.getvalue())
    for entry in re.finditer(b"PK\x01\x02", content):
        # size when inflated
        content[entry.start() + 24 : entry.start() + 28] = (3 << 30).to_bytes(4, "little")
    with pytest.raises(ValueError, match="6,442 MB"):
        read_arrays(io.BytesIO(content))


@pytest.mark.parametrize("read", [read_arrays, read_headers])
@pytest.mark.parametrize(("shape", "size"), [((6, 3), 72), ((4, 3), 48), ((5, 3, 1000), 60_000)])
def test_an_array_that_is_not_as_long_as_its_header_says_is_refused(shape, size, read):
    assert read_arrays(with_shape((5, 3)))["points"].shape == (5, 3)
    with pytest.raises(ValueError, match=rf"of 60 bytes should have {size}"):
        read(with_shape(shape))


def with_members(*members, compression=zipfile.ZIP_STORED):
    """A file with these arrays under one name."""
    file = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", compression) as archive:
        warnings.simplefilter("ignore")  # of a name that is there twice
        for array in members:
            member = io.BytesIO()
            np.save(member, array)
            archive.writestr("points.npy", member.getvalue())
    return file


@pytest.mark.parametrize("read", [read_arrays, read_headers])
@pytest.mark.parametrize(
    ("file", "word"),
    [
        (with_members(np.zeros(3), np.ones(3)), "'points' twice"),
        (with_members(np.zeros(3), compression=zipfile.ZIP_BZIP2), "another method than deflate"),
        (with_members(np.zeros(3, [("x", "<f4")])), "dtype"),
        (with_shape((-5, -3)), "shape"),
    ],
    ids=["twice", "compression", "structured", "negative"],
)
def test_an_unusual_archive_is_refused(file, word, read):
    with pytest.raises(ValueError, match=word):
        read(file)
