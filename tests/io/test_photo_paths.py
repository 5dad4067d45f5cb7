"""Paths that lead to no photo: each is refused at once, in one line with the path."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physic_core.errors import InputError
from physic_core.io.photo import read_photo, read_source
from physic_core.io.result_folder import file_digest

NOT_REGULAR = "it is not a regular file; name one image file"


def message_of(path: object) -> str:
    with pytest.raises(InputError) as caught:
        read_photo(path)  # type: ignore[arg-type]
    return str(caught.value)


def test_pipes_and_sockets_are_refused_without_waiting(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    assert message_of(tmp_path / "pipe") == f"cannot read the photo {tmp_path / 'pipe'}: {NOT_REGULAR}"
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(os.path.relpath(tmp_path / "socket"))  # an absolute path may be too long
        assert message_of(tmp_path / "socket") == f"cannot read the photo {tmp_path / 'socket'}: {NOT_REGULAR}"


def test_a_pipe_that_takes_the_place_of_a_file_is_refused_without_waiting(tmp_path: Path, monkeypatch):
    path = tmp_path / "photo.png"
    path.write_bytes(b"a file")
    status = path.stat()
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(Path, "stat", lambda self: status)
    assert message_of(path) == f"cannot read the photo {path}: {NOT_REGULAR}"


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("a\nb.jpg", r"a\nb.jpg"),
        ("\x1b[31mred.jpg", r"\x1b[31mred.jpg"),
        ("caf\udce9.jpg", r"caf\udce9.jpg"),
        ("\u202egpj.exe", r"\u202egpj.exe"),
        ("Übung 写真.jpg", "Übung 写真.jpg"),
    ],
)
def test_names_cannot_change_a_message(name: str, shown: str, tmp_path: Path):
    path = tmp_path / name
    assert message_of(path) == f"cannot read the photo {tmp_path}/{shown}: there is no such file; check the path"
    Image.fromarray(np.full((64, 64, 3), 9, np.uint8)).save(os.fsencode(path), "PNG")
    assert read_photo(path).image.shape == (64, 64, 3)


@pytest.mark.parametrize(("path", "shown"), [("a\0b.jpg", r"a\x00b.jpg"), ("\ud800.jpg", r"\ud800.jpg")])
def test_a_path_that_no_file_can_have_is_refused(path: str, shown: str):
    expected = f"cannot read the photo {shown}: the path has characters that no path can have; check the path"
    assert message_of(path) == expected


def test_a_photo_that_is_replaced_has_the_digest_of_the_pixels_that_were_read(tmp_path: Path, monkeypatch):
    from physic_core.io import photo

    path, other = tmp_path / "photo.png", tmp_path / "other.png"
    for place, value in ((path, 10), (other, 200)):
        Image.fromarray(np.full((64, 64, 3), value, np.uint8)).save(place)
    expected = file_digest(path)
    read = photo._read

    def replace_then_read(*arguments):
        os.replace(other, path)
        return read(*arguments)

    monkeypatch.setattr(photo, "_read", replace_then_read)
    found = read_source(path)
    assert found.image.max() == 10
    assert found.digest == expected
