"""Fetching from a web server, here one on this machine, and what stops it."""

from __future__ import annotations

import hashlib
import io
import zipfile

import pytest

from physic_core.weights import WeightFile, locate, read_manifest
from physic_setup.fetch import fetch

from .conftest import CONTENT, HASH, left, refusal, weights, write

pytestmark = pytest.mark.quick


def one(source, content=CONTENT, path="model.onnx", **keys):
    return weights(
        WeightFile(path, len(content), hashlib.sha256(content).hexdigest(), source), **keys
    )


def test_a_file_is_fetched_once_and_found_by_its_name(server, own_cache, add_list):
    url = server.add("/model.onnx", CONTENT)
    file = {"path": "model.onnx", "bytes": len(CONTENT), "sha256": HASH, "source": url}
    folder = add_list("net", file)
    chosen = read_manifest(folder)["net"]
    reported = []
    assert fetch(chosen, report=reported.append) == ("model.onnx",)
    assert locate(folder, "net").read_bytes() == CONTENT
    assert reported == list(chosen.files)
    assert fetch(chosen) == ()
    assert len(server.asked) == 1
    assert left(own_cache) == ["net/model.onnx"]


def test_a_lost_connection_leaves_nothing(server, own_cache):
    url = server.add("/model.onnx", CONTENT, cut=262_144)
    assert refusal(one(url)).startswith(url)
    assert left(own_cache) == []
    fetch(one(url))
    assert left(own_cache) == ["net/model.onnx"]


@pytest.mark.parametrize("code", [401, 404, 500])
def test_a_refusal_of_a_server_is_reported_with_the_homepage(server, code):
    url = server.add("/model.onnx", status=code)
    message = refusal(one(url, homepage="https://example.org/net"))
    assert str(code) in message
    assert message.endswith("see https://example.org/net")


@pytest.mark.parametrize(
    "keys", [{"commercial": False}, {"commercial": None}, {"account": True}], ids=str
)
def test_restricted_weights_are_fetched_only_with_accept_license(server, keys):
    chosen = one(
        server.add("/model.onnx", CONTENT),
        license="Own license",
        homepage="https://example.org",
        **keys,
    )
    message = refusal(chosen)
    assert "Own license" in message
    assert "https://example.org" in message
    assert "physic weights fetch net --accept-license" in message
    assert server.asked == []
    assert fetch(chosen, accept=True) == ("model.onnx",)


def test_a_file_of_another_size_is_not_taken_for_the_published_one(server, own_cache):
    chosen = one(server.add("/model.onnx", CONTENT))
    there = write(own_cache / "net" / "model.onnx", b"cut off")
    assert f"7 bytes instead of {len(CONTENT)}" in refusal(chosen)
    there.unlink()
    assert fetch(chosen) == ("model.onnx",)


def zipped(**members):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name.replace("__", "/"), content)
    return out.getvalue()


def test_members_come_out_of_a_zip(server, own_cache):
    url = server.add("/all.zip", zipped(x__a=CONTENT, x__b=b"b", other=b"no"))
    both = weights(
        WeightFile("model.onnx", len(CONTENT), HASH, f"{url}#x/a"),
        WeightFile("deep/b", source=f"{url}#x/b"),
    )
    assert fetch(both) == ("model.onnx", "deep/b")
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT
    assert (own_cache / "net" / "deep" / "b").read_bytes() == b"b"
    assert left(own_cache) == ["net/deep/b", "net/model.onnx"]


def test_names_inside_a_zip_cannot_leave_the_folder(server, own_cache, tmp_path):
    url = server.add("/all.zip", zipped(**{"../../evil": b"evil", "/abs": b"evil", "a": b"a"}))
    before = left(tmp_path)
    assert fetch(weights(WeightFile("model.onnx", source=f"{url}#a"))) == ("model.onnx",)
    assert left(tmp_path) == sorted([*before, "cache/physic/weights/net/model.onnx"])


def test_a_download_that_is_no_zip_is_reported_and_removed(server, own_cache):
    url = server.add("/all.zip", b"<html>please log in</html>")
    assert "zip" in refusal(weights(WeightFile("a", source=f"{url}#a")))
    assert left(own_cache) == []
