"""Fetching from Hugging Face's hub, here a server on this machine that answers what the library
asks of it.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import physic_onnx
from physic_core.errors import DownloadError
from physic_core.weights import WeightFile, locate, read_manifest
from physic_core.weights.find import find_weights
from physic_onnx.sessions import OnnxOptions, open_network
from physic_setup.fetch import fetch

from .conftest import ADDED, COMMIT, CONTENT, HASH, left, refusal, toy_graph, weights

pytestmark = pytest.mark.quick

CONFIG = b'{"hidden_size": 8}'


class Hub:
    """The pages of repositories."""

    def __init__(self, server):
        self.server = server

    def add(self, path, content, repository="owner/net", revision="main"):
        """Serve a file, large ones from another place as the hub does; return its source."""
        address = f"/{repository}/resolve/{revision}/{path}"
        headers = {"X-Repo-Commit": COMMIT}
        if len(content) > 1000:
            etag = hashlib.sha256(content).hexdigest()
            there = self.server.add(f"/cdn/{etag}", content, etag='"of the cdn"')
            linked = {
                "X-Linked-Etag": f'"{etag}"',
                "X-Linked-Size": str(len(content)),
                # Another host, since the library follows what stays on the same one.
                "Location": there.replace("127.0.0.1", "localhost"),
            }
            self.server.add(address, status=302, headers=headers | linked)
        else:
            etag = hashlib.sha1(b"blob %d\0" % len(content) + content).hexdigest()  # as git's
            self.server.add(address, content, etag=f'"{etag}"', headers=headers)
        return f"hf://{repository}/{path}" + ("" if revision == "main" else f"@{revision}")

    def refuse(self, path, code=""):
        headers = {"X-Error-Message": "no"} | ({"X-Error-Code": code} if code else {})
        self.server.add(f"/owner/net/resolve/main/{path}", status=403, headers=headers)
        return f"hf://owner/net/{path}"


@pytest.fixture
def hub(server, monkeypatch, tmp_path):
    from huggingface_hub import constants, file_download, utils

    monkeypatch.setattr(constants, "ENDPOINT", server.address)
    template = server.address + "/{repo_id}/resolve/{revision}/{filename}"
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    # before 1.0
    monkeypatch.setattr(file_download, "HUGGINGFACE_CO_URL_TEMPLATE", template, raising=False)
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
    for name in ("HF_TOKEN", "HUGGING_FACE_HUB_TOKEN", "HF_OIDC_RESOURCE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "token"))
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_IMPLICIT_TOKEN", False)
    yield Hub(server)
    # The library keeps connections for later requests: none of them must reach the server of
    # another test.
    (getattr(utils, "close_session", None) or utils.reset_sessions)()


def test_a_set_of_one_repository_comes_into_the_librarys_cache(hub, add_list, own_cache, tmp_path):
    stated = {"bytes": len(CONTENT), "sha256": HASH}
    folder = add_list(
        "net",
        {"path": "model.onnx", "source": hub.add("onnx/model.onnx", CONTENT), **stated},
        {"path": "config.json", "source": hub.add("onnx/config.json", CONFIG)},
    )
    chosen = read_manifest(folder)["net"]
    assert fetch(chosen) == ("model.onnx", "config.json")
    snapshot = tmp_path / "hub" / "models--owner--net" / "snapshots" / COMMIT / "onnx"
    assert locate(folder, "net") == snapshot
    assert (snapshot / "model.onnx").read_bytes() == CONTENT
    assert (snapshot / "config.json").read_bytes() == CONFIG
    assert left(own_cache) == []
    asked = len(hub.server.asked)
    assert fetch(chosen) == ()
    assert len(hub.server.asked) == asked


def test_files_in_several_places_are_gathered_without_a_network(hub, own_cache, server, add_list):
    one = {"path": "encoder.onnx", "source": hub.add("encoder.onnx", CONTENT)}
    other = {
        "path": "decoder.onnx",
        "source": hub.add("decoder.onnx", CONFIG, repository="owner/other"),
    }
    for file in (one, other):
        fetch(weights(WeightFile(**file)))
    server.close()
    folder = add_list("net", one, other)
    assert fetch(read_manifest(folder)["net"]) == ("encoder.onnx", "decoder.onnx")
    assert locate(folder, "net") == own_cache / "net"


@pytest.mark.parametrize("to", [None, "stick"])
@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"sha256": "ab" * 32}, f"its SHA-256 is {HASH} instead of {'ab' * 32}"),
        ({"bytes": 7}, f"it has {len(CONTENT)} bytes instead of 7: removed"),
    ],
)
def test_a_file_that_differs_from_the_manifest_is_removed(hub, tmp_path, to, stated, said):
    file = WeightFile("model.onnx", source=hub.add("model.onnx", CONTENT), **stated)
    assert said in refusal(weights(file), to=to and tmp_path / to)
    assert [name for name in left(tmp_path) if "model.onnx" in name or HASH in name] == []


def test_a_token_goes_to_the_hub_and_not_to_where_it_sends_us(hub, server, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", "hf_mine")
    fetch(weights(WeightFile("model.onnx", source=hub.add("model.onnx", CONTENT))))
    tokens = {
        path: headers.get("Authorization", headers.get("authorization"))
        for _, path, headers in server.asked
    }
    assert tokens == {"/owner/net/resolve/main/model.onnx": "Bearer hf_mine", f"/cdn/{HASH}": None}


def test_behind_a_gate_a_mirror_is_taken_that_has_a_file_of_the_same_hash(hub, own_cache):
    """The mirror may name its files as it likes; of a small one the hub tells the size alone."""
    hub.add("any/name.bin", CONTENT, repository="other/mirror", revision=COMMIT)
    hub.add("settings", CONFIG, repository="other/mirror", revision=COMMIT)
    large = {"sha256": HASH, "size": len(CONTENT), "pointerSize": 134}
    siblings = [
        {"rfilename": "README.md", "size": 3},
        {"rfilename": "settings", "size": len(CONFIG)},
        {"rfilename": "any/name.bin", "size": len(CONTENT), "lfs": large},
    ]
    page = json.dumps({"id": "other/mirror", "sha": COMMIT, "siblings": siblings}).encode()
    hub.server.add("/api/models/other/mirror", page, headers={"Content-Type": "application/json"})
    gated = weights(
        WeightFile("model.ckpt", len(CONTENT), HASH, hub.refuse("model.ckpt", "GatedRepo")),
        WeightFile(
            "config.yaml",
            len(CONFIG),
            hashlib.sha256(CONFIG).hexdigest(),
            hub.refuse("config.yaml"),
        ),
        account=True,
        mirrors=("other/mirror",),
    )
    with pytest.raises(DownloadError, match="without --accept-license"):
        fetch(gated)
    assert fetch(gated, accept=True) == ("model.ckpt", "config.yaml")
    assert left(own_cache) == ["net/config.yaml", "net/model.ckpt"]
    assert fetch(gated) == ()


MANIFEST = Path(physic_onnx.__file__).with_name("weights")
IN_TWO_FILES = {
    name: weights
    for name, weights in read_manifest(MANIFEST).items()
    if any("data" in file.path for file in weights.files)
}


def opens(path):
    (found,) = open_network(path, OnnxOptions(), "cpu").run({"x": np.zeros(400)}, ["y"])
    return found.tolist() == ADDED.tolist()


@pytest.fixture
def lay_set(lay):
    """A function that lays toy files of a set, whose data follow their graphs."""

    def run(chosen):
        for graph, data in zip(chosen.files[::2], chosen.files[1::2], strict=True):
            lay(graph.origin, toy_graph(Path(data.origin.path).name))
            lay(data.origin, ADDED.tobytes())

    return run


@pytest.mark.parametrize("name", IN_TWO_FILES)
def test_graphs_and_data_behind_links_of_the_librarys_cache_open(lay_set, name):
    lay_set(IN_TWO_FILES[name])
    graphs = [file.path for file in IN_TWO_FILES[name].files if file.path.endswith(".onnx")]
    folder = find_weights(MANIFEST, name)
    for graph in graphs:
        assert (folder / graph).is_symlink()
        assert opens(folder / graph)
        assert opens(find_weights(MANIFEST, name, graph))
