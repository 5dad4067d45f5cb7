from __future__ import annotations

import os
import re

import pytest

from physic_core.errors import WeightsMissingError
from physic_core.weights import HubSource, fingerprint, locate, missing

from .conftest import toy_graph, write

pytestmark = pytest.mark.quick

SOURCE = "hf://owner/net/model.onnx"


@pytest.fixture
def net(add_list):
    """The folder with the list of one set named net, of one file."""
    return add_list("net", {"path": "model.onnx", "source": SOURCE})


def test_tensors_in_other_files_of_an_onnx_file_belong_to_it(net, tmp_path):
    names = ("net.onnx.data", f"{'long' * 40}.bin")
    own = str(write(tmp_path / "own" / "net.onnx", toy_graph(*names)))
    (message,) = missing(net, own)
    assert all(name in message for name in names)
    for name in names:
        write(tmp_path / "own" / name, b"1234")
    assert missing(net, own) == ()
    digests = {fingerprint(net, own)}
    for name in names:
        write(tmp_path / "own" / name, b"5678")
        digests.add(fingerprint(net, own))
    assert len(digests) == 3


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
    assert f"`physic weights fetch net --accept-licence` ({words}" in message


def test_a_path_of_the_users_own_is_taken_as_it_is(net, tmp_path):
    mine = write(tmp_path / "mine" / "x.onnx")
    assert locate(net, str(mine)) == locate(net, str(mine), "model.onnx") == mine
    assert locate(net, str(mine.parent)) == mine.parent
    assert locate(net, str(mine.parent), "x.onnx") == mine


@pytest.mark.parametrize(
    ("value", "file", "says"),
    [
        ("/no/such", None, "no file or folder /no/such"),
        ("such.onnx", None, "no file or folder such.onnx"),
        ("nett", None, "no weight set, file or folder is named 'nett'. Did you mean 'net'?"),
        ("x", None, "no weight set, file or folder is named 'x'; there are: net"),
        (
            " ",
            None,
            "the option weights is empty: set it to a name of `physic weights list`, or to a path",
        ),
        ("{tmp}", "model.onnx", "no file model.onnx in the folder {tmp}"),
    ],
)
def test_a_missing_weight_path_is_named(net, tmp_path, value, file, says):
    value = value.replace("{tmp}", str(tmp_path))
    with pytest.raises(WeightsMissingError, match=re.escape(says.replace("{tmp}", str(tmp_path)))):
        locate(net, value, file)


def test_a_sets_name_goes_before_a_folder_of_that_name(add_list, own_cache, tmp_path, monkeypatch):
    folder = add_list("sam2.1-tiny", {"path": "model.onnx", "source": SOURCE})
    there = write(own_cache / "sam2.1-tiny" / "model.onnx")
    (tmp_path / "sam2.1-tiny").mkdir()
    monkeypatch.chdir(tmp_path)
    assert locate(folder, "sam2.1-tiny") == there


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


def test_a_fingerprint_of_files_without_a_published_hash_follows_their_content(
    net, own_cache, tmp_path
):
    one, two, listed = (
        write(path)
        for path in (
            tmp_path / "one" / "x",
            tmp_path / "two" / "x",
            own_cache / "net" / "model.onnx",
        )
    )
    os.utime(two, (5, 5))
    assert fingerprint(net, str(one)) == fingerprint(net, str(two))
    assert fingerprint(net, str(one.parent)) == fingerprint(net, str(two.parent))
    before = fingerprint(net, "net")
    for path in (two, listed):
        time = path.stat().st_mtime_ns
        path.write_bytes(b"WEIGHTS")
        os.utime(path, ns=(time, time))
    assert fingerprint(net, "net") != before
    assert fingerprint(net, str(one)) != fingerprint(net, str(two))
    assert fingerprint(net, str(one.parent)) != fingerprint(net, str(two.parent))
