from __future__ import annotations

import os
import re

import pytest

from physic_core.errors import WeightsMissingError
from physic_core.weights import HubSource, fingerprint, locate, missing

from .conftest import write

pytestmark = pytest.mark.quick

SOURCE = "hf://owner/net/model.onnx"


@pytest.fixture
def net(add_list):
    """The folder with the list of one set named net, of one file."""
    return add_list("net", {"path": "model.onnx", "source": SOURCE})


def test_folders_of_the_environment_in_their_order_come_before_the_cache_and_hugging_faces_last(
    net, own_cache, tmp_path, monkeypatch, lay
):
    first = tmp_path / "first"
    second = tmp_path / "second"
    monkeypatch.setenv("PHYSIC_WEIGHTS", f"{first}{os.pathsep}{second}")
    there = lay(HubSource("owner/net", "model.onnx"))
    assert locate(net, "net") == there
    for folder in (own_cache, second, first):
        there = write(folder / "net" / "model.onnx")
        assert locate(net, "net") == locate(net, "net", "model.onnx") == there
    assert missing(net, "net") == ()


def test_a_snapshot_is_the_folder_of_a_set_that_lies_in_it_as_listed(add_list, lay):
    names = ("config.json", "model.safetensors")
    folder = add_list("net", *({"path": n, "source": f"hf://owner/net/{n}"} for n in names))
    there = [lay(HubSource("owner/net", name)) for name in names]
    assert locate(folder, "net") == there[0].parent
    assert locate(folder, "net", "config.json") == there[0]


def test_missing_weights_are_named_with_size_licence_command_and_searched_folders(
    add_list, own_cache, tmp_path, monkeypatch
):
    folder = add_list("net", {"path": "model.onnx", "source": SOURCE, "bytes": 140852051})
    monkeypatch.setenv("PHYSIC_WEIGHTS", str(tmp_path / "mine"))
    with pytest.raises(WeightsMissingError) as caught:
        locate(folder, "net")
    assert str(caught.value) == (
        "weights 'net' (141 MB, MIT) are missing: `physic weights fetch net`\n"
        f"searched: {tmp_path / 'mine' / 'net'}, {own_cache / 'net'}, Hugging Face's cache"
    )


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"commercial": False}, "commercial use NOT allowed"),
        ({"commercial": None}, "commercial use not stated"),
        ({"account": True}, "an account with access, commercial use allowed"),
    ],
)
def test_how_to_get_it_follows_the_licence(add_list, keys, words):
    (message,) = missing(add_list("net", {"path": "a", "source": SOURCE}, **keys), "net")
    assert f"`physic weights fetch net --accept-license` ({words}" in message


@pytest.mark.parametrize(
    ("name", "file", "says"),
    [
        ("nett", None, "no weights are named 'nett'. Did you mean 'net'?"),
        ("/mine/model.onnx", None, "no weights are named '/mine/model.onnx'; there are: net"),
        ("net", "other.onnx", "weights 'net' have no file other.onnx, only model.onnx"),
    ],
)
def test_other_weights_are_refused_by_name(net, name, file, says):
    with pytest.raises(WeightsMissingError, match=re.escape(says)):
        locate(net, name, file)


def test_a_fingerprint_is_that_of_the_published_file_wherever_it_lies(add_list, own_cache, lay):
    folder = add_list(
        "net", {"path": "model.onnx", "source": SOURCE, "bytes": 7, "sha256": "ab" * 32}
    )
    assert fingerprint(folder, "net") == ""
    there = lay(HubSource("owner/net", "model.onnx"))
    first = fingerprint(folder, "net")
    os.utime(there, (1, 1))
    assert fingerprint(folder, "net") == first != ""
    write(own_cache / "net" / "model.onnx", b"others!!")
    assert fingerprint(folder, "net") != first


def test_a_fingerprint_of_files_without_a_published_hash_follows_their_content(net, own_cache):
    listed = write(own_cache / "net" / "model.onnx")
    before = fingerprint(net, "net")
    time = listed.stat().st_mtime_ns
    listed.write_bytes(b"WEIGHTS")
    os.utime(listed, ns=(time, time))
    assert fingerprint(net, "net") != before
