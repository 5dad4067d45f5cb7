"""A weight file that is used is the published one: its SHA-256 is compared when it is loaded."""

from __future__ import annotations

import hashlib
import os

import pytest

from physic_core.errors import BackendError
from physic_core.weights import fingerprint, locate, missing

from .conftest import write

pytestmark = pytest.mark.quick

CONTENT = b"weights" * 1000
DIGEST = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def folder(add_list):
    file = {
        "path": "model.onnx",
        "source": "hf://owner/net/model.onnx",
        "bytes": len(CONTENT),
        "sha256": DIGEST,
    }
    return add_list("net", file)


@pytest.fixture
def model(own_cache):
    return write(own_cache / "net" / "model.onnx", CONTENT)


def flip_bit(path):
    """Change a bit, as a failing disk does, without a trace in size and time; return the
    SHA-256.
    """
    before = path.stat()
    content = bytearray(path.read_bytes())
    content[3456] ^= 4
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return hashlib.sha256(content).hexdigest()


def refusal(folder):
    with pytest.raises(BackendError) as caught:
        locate(folder, "net")
    return str(caught.value)


def test_a_damaged_file_is_refused_and_not_missing(folder, model):
    found = flip_bit(model)
    message = refusal(folder)
    assert f"{model} is not the published file" in message
    assert f"{found} instead of {DIGEST}" in message
    assert "physic weights fetch net" in message
    assert missing(folder, "net") == ()


def test_a_file_of_another_size_is_refused_without_reading_it(folder, model, monkeypatch):
    model.write_bytes(CONTENT[:-1])
    monkeypatch.setattr(hashlib, "file_digest", None)
    assert "is not the published file: it has 6999 bytes instead of 7000: " in refusal(folder)


def test_looking_for_files_reads_none(folder, model, monkeypatch):
    monkeypatch.setattr(hashlib, "file_digest", None)
    assert missing(folder, "net") == ()
    assert fingerprint(folder, "net")
