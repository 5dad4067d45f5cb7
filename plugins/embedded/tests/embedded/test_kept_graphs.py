"""Optimised graphs of the packaged networks in the cache."""

from __future__ import annotations

import os
import struct
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from physic_core.cache.folders import CACHE_VARIABLE
from physic_embedded.networks.sessions import open_packaged_session

NETWORK = "palm_detection_full"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "graphs"


def outputs():
    session = open_packaged_session(NETWORK, threads=1)
    one = session.session.get_inputs()[0]
    return session.run(None, {one.name: np.random.default_rng(0).random(one.shape, np.float32)})


def assert_same(first, second):
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_kept_graph_gives_the_same_outputs(folder, monkeypatch):
    made = outputs()
    [kept] = folder.iterdir()
    before = kept.stat().st_ino
    assert_same(outputs(), made)
    assert [file.stat().st_ino for file in folder.iterdir()] == [before]
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert_same(outputs(), made)


def test_the_cache_can_be_filled_before_the_first_photo(folder, physic):
    hands = ("--preset", "mock", "--set", "hand_estimator.backend=embedded")
    done = physic("cache", "fill", *hands)
    assert done.exit_code == 0
    kept = sorted(folder.iterdir())
    assert len(kept) >= 2
    physic("cache", "fill", *hands)
    assert sorted(folder.iterdir()) == kept


def summed(content, length):
    """The content of a kept file: weights and a graph, the graph's length and the sum of both."""
    padded = content + bytes(-len(content) % 8)
    total = np.frombuffer(padded, "<u8").sum(dtype=np.uint64)
    return content + struct.pack("<QQ", length, total)


DAMAGES = {
    "empty": lambda content: b"",
    "first byte": lambda content: bytes([content[0] ^ 1]) + content[1:],
    "last byte": lambda content: content[:-1] + bytes([content[-1] ^ 1]),
    "short": lambda content: content[:-1],
    "no graph": lambda content: b"no graph",
    "no graph with its sum": lambda content: summed(b"no graph", 8),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_graph_is_made_again(folder, damage):
    made = outputs()
    [kept] = folder.iterdir()
    content = kept.read_bytes()
    kept.write_bytes(DAMAGES[damage](content))
    assert_same(outputs(), made)
    [kept] = folder.iterdir()
    assert len(kept.read_bytes()) == len(content)


def forge(kept):
    """Negate weights of a kept graph, with a sum that is right."""
    content = bytearray(kept.read_bytes())
    length, _ = struct.unpack("<QQ", content[-16:])
    for sign in range(3, len(content) // 2, 4):
        content[sign] ^= 0x80
    kept.write_bytes(summed(bytes(content[:-16]), length))


@pytest.mark.skipif(os.name != "posix", reason="this system has no modes of files")
@pytest.mark.parametrize("owner", ["the user", "another user"])
def test_a_graph_that_others_could_write_is_not_opened(folder, owner, monkeypatch):
    made = outputs()
    [kept] = folder.iterdir()
    forge(kept)
    with pytest.raises(AssertionError):
        assert_same(outputs(), made)
    if owner == "the user":
        folder.chmod(0o777)
    else:
        monkeypatch.setattr(os, "geteuid", lambda: kept.stat().st_uid + 1)
    assert_same(outputs(), made)


@pytest.mark.skipif(os.name != "posix", reason="this system has no modes of files")
def test_a_graph_is_kept_for_its_user_alone(folder):
    before = os.umask(0)
    try:
        outputs()
    finally:
        os.umask(before)
    assert [path.stat().st_mode & 0o777 for path in (folder, *folder.iterdir())] == [0o700, 0o600]


def test_networks_open_where_nothing_can_be_kept(folder):
    folder.parent.write_text("a file in place of the folder")
    assert len(outputs()) == 2


def test_several_writers_leave_complete_graphs(folder):
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda _: outputs(), range(4)))
    names = [file.name for file in folder.iterdir()]
    assert names
    assert all(name.endswith(".graph.onnx") and not name.startswith(".") for name in names)
    for run in runs:
        assert_same(run, runs[0])
