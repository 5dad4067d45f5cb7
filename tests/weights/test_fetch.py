"""Fetching from a web server, here one on this machine: whole, in pieces, and what stops it."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import zipfile
from pathlib import Path
from typing import Any

import pytest

from physic_core.errors import DownloadError
from physic_core.weights import WeightFile, WeightSet, locate, read_manifest
from physic_setup import transfer as transferring
from physic_setup.fetch import fetch

CONTENT = bytes(range(256)) * 4096  # 1 MB
HASH = hashlib.sha256(CONTENT).hexdigest()


def weights(*files: WeightFile, **keys: Any) -> WeightSet:
    known = {"summary": "", "license": "MIT", "commercial": True, "account": False, "homepage": "", "advice": ""}
    return WeightSet(name="net", files=files, **(known | keys))


def one(source: str, content: bytes = CONTENT, path: str = "model.onnx", **keys: Any) -> WeightSet:
    return weights(WeightFile(path, len(content), hashlib.sha256(content).hexdigest(), source), **keys)


def refusal(chosen: WeightSet, **settings: Any) -> str:
    with pytest.raises(DownloadError) as caught:
        fetch(chosen, **settings)
    return str(caught.value)


def left(folder: Path) -> list[str]:
    """What lies in a folder, hidden files included."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


# ---- what goes well --------------------------------------------------------------------------------------------------


def test_a_file_is_fetched_once_and_found_by_its_name(server: Any, own_cache: Path, lists: Any):
    url = server.add("/model.onnx", CONTENT)
    folder = lists.add("net", {"path": "model.onnx", "bytes": len(CONTENT), "sha256": HASH, "source": url})
    chosen = read_manifest(folder)["net"]
    steps: list[tuple[str, int, int | None]] = []
    assert fetch(chosen, progress=lambda *step: steps.append(step)) == ("model.onnx",)
    assert locate(folder, "net").read_bytes() == CONTENT
    assert steps[0] == ("model.onnx", 0, len(CONTENT))
    assert steps[-1] == ("model.onnx", len(CONTENT), len(CONTENT))
    assert fetch(chosen) == ()
    assert len(server.asked) == 1
    assert left(own_cache) == ["net/model.onnx"]


def test_only_missing_files_of_a_set_are_fetched(server: Any, own_cache: Path):
    both = weights(
        WeightFile("a.onnx", source=server.add("/a", b"a")), WeightFile("deep/b.onnx", source=server.add("/b", b"b"))
    )
    (own_cache / "net").mkdir(parents=True)
    (own_cache / "net" / "a.onnx").write_bytes(b"mine")
    assert fetch(both) == ("deep/b.onnx",)
    assert (own_cache / "net" / "a.onnx").read_bytes() == b"mine"
    assert (own_cache / "net" / "deep" / "b.onnx").read_bytes() == b"b"


def test_a_chosen_folder_gets_the_complete_set_without_a_second_download(server: Any, tmp_path: Path, monkeypatch):
    chosen = one(server.add("/model.onnx", CONTENT))
    fetch(chosen)
    assert fetch(chosen, to=tmp_path / "stick") == ("model.onnx",)
    assert (tmp_path / "stick" / "net" / "model.onnx").read_bytes() == CONTENT
    assert len(server.asked) == 1
    assert left(tmp_path / "stick") == ["net/model.onnx"]


# ---- interruptions ---------------------------------------------------------------------------------------------------


def test_a_broken_connection_is_taken_up_again_at_once(server: Any, own_cache: Path, no_pause: None):
    chosen = one(server.add("/model.onnx", CONTENT, cut=[262_144, 131_072]))
    fetch(chosen)
    assert server.ranges("/model.onnx") == ["", "bytes=262144-", "bytes=393216-"]
    assert left(own_cache) == ["net/model.onnx"]


def test_the_next_fetch_goes_on_where_the_last_one_stopped(server: Any, own_cache: Path, no_pause: None):
    url = server.add("/model.onnx", CONTENT, cut=[262_144, 0])
    assert refusal(one(url)) == (f"{url}: the connection was lost; 262 kB are kept; the next download resumes")
    assert left(own_cache) == ["net/model.onnx.part", "net/model.onnx.part.of"]
    steps: list[int] = []
    fetch(one(url), progress=lambda file, done, total: steps.append(done))
    assert steps[0] == 262_144
    assert server.ranges("/model.onnx")[-1] == "bytes=262144-"
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT
    assert left(own_cache) == ["net/model.onnx"]


def test_ctrl_c_keeps_the_partial_download(server: Any, own_cache: Path):
    chosen = one(server.add("/model.onnx", CONTENT))

    def interrupt(file: str, done: int, total: int | None) -> None:
        if done > 400_000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fetch(chosen, progress=interrupt)
    here = (own_cache / "net" / "model.onnx.part").stat().st_size
    assert 400_000 < here < len(CONTENT)
    assert left(own_cache) == ["net/model.onnx.part", "net/model.onnx.part.of"]
    fetch(chosen)
    assert server.ranges("/model.onnx") == ["", f"bytes={here}-"]
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT


def test_a_server_without_range_requests_restarts_the_download(server: Any, own_cache: Path, no_pause: None):
    chosen = one(server.add("/model.onnx", CONTENT, cut=[262_144], ranges=False))
    fetch(chosen)
    assert server.ranges("/model.onnx") == ["", "bytes=262144-"]
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT


def test_a_partial_download_of_another_version_is_discarded(server: Any, own_cache: Path, no_pause: None):
    """Without a published hash only the server's tag can tell that the rest belongs to what has come."""
    url = server.add("/model.onnx", CONTENT, cut=[262_144, 0], etag='"one"')
    unhashed = weights(WeightFile("model.onnx", source=url))
    refusal(unhashed)
    server.add("/model.onnx", CONTENT[::-1], etag='"two"')
    fetch(unhashed)
    assert server.asked[-1][2]["If-Range"] == '"one"'
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT[::-1]


def test_a_complete_partial_download_needs_no_connection(server: Any, own_cache: Path):
    """The process ended between the last byte and the file's last name."""
    url = server.add("/model.onnx", CONTENT)
    (own_cache / "net").mkdir(parents=True)
    (own_cache / "net" / "model.onnx.part").write_bytes(CONTENT)
    (own_cache / "net" / "model.onnx.part.of").write_text(f"{url}\n\n")
    fetch(one(url))
    assert server.asked == []
    assert left(own_cache) == ["net/model.onnx"]


def test_two_fetches_do_not_write_into_one_file(server: Any, own_cache: Path):
    fcntl = pytest.importorskip("fcntl")
    chosen = one(server.add("/model.onnx", CONTENT))
    part = own_cache / "net" / "model.onnx.part"
    part.parent.mkdir(parents=True)
    with part.open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(b"of the other")
        file.flush()
        assert refusal(chosen) == f"another download is writing {part}: wait until it is done"
    assert part.read_bytes() == b"of the other"


# ---- what is wrong with what comes -----------------------------------------------------------------------------------


def test_a_wrong_hash_is_said_and_the_file_removed(server: Any, own_cache: Path):
    other = CONTENT[::-1]
    url = server.add("/model.onnx", other)
    assert refusal(weights(WeightFile("model.onnx", len(CONTENT), HASH, url), homepage="https://example.org")) == (
        f"{url} was downloaded, but its SHA-256 is {hashlib.sha256(other).hexdigest()} instead of {HASH}: removed; "
        "see https://example.org"
    )
    assert left(own_cache) == []


def test_a_wrong_size_is_said_before_the_file_has_come(server: Any, own_cache: Path):
    url = server.add("/model.onnx", CONTENT)
    assert refusal(weights(WeightFile("model.onnx", 7, HASH, url))) == (
        f"{url} has {len(CONTENT)} bytes, but the manifest states 7: the file has changed"
    )
    assert left(own_cache) == []


def test_a_wrong_size_is_reported_without_a_content_length(server: Any, own_cache: Path, no_pause: None):
    url = server.add("/model.onnx", b"too long", length=False)
    assert refusal(weights(WeightFile("model.onnx", 7, None, url))) == (
        f"{url} was downloaded, but it has 8 bytes instead of 7: removed"
    )
    assert left(own_cache) == []
    server.add("/model.onnx", b"short", length=False)
    assert refusal(weights(WeightFile("model.onnx", 7, None, url))) == (
        f"{url}: the connection was lost; 5 bytes are kept; the next download resumes"
    )


# ---- servers that refuse ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", [401, 403])
def test_weights_with_an_account_name_the_way_to_get_them(server: Any, own_cache: Path, code: int):
    url = server.add("/model.onnx", status=code)
    chosen = one(url, account=True, homepage="https://example.org/net", advice="ask there")
    assert refusal(chosen, accept=True) == (
        f"{url} refuses access (HTTP {code}): licence     MIT\n"
        "  commercial  use is allowed\n"
        "  account     needed: request access at https://example.org/net, and log in there\n"
        "  homepage    https://example.org/net\n"
        f"or download it with a browser to {own_cache / 'net' / 'model.onnx'}"
    )


def test_a_source_that_is_gone_names_the_homepage(server: Any):
    url = f"{server.address}/gone"
    assert refusal(one(url, homepage="https://example.org")) == (
        f"{url} does not exist (HTTP 404): see https://example.org"
    )


def test_a_missing_network_connection_is_reported(server: Any):
    url = server.add("/model.onnx", CONTENT)
    server.close()
    assert refusal(one(url)) == f"{url}: the server cannot be reached: check the network connection"


def test_a_server_that_falls_silent_is_said(server: Any, monkeypatch: pytest.MonkeyPatch, no_pause: None):
    import socket

    listening = socket.create_server(("127.0.0.1", 0))
    monkeypatch.setattr(transferring, "_READ_SECONDS", 0.2)
    url = f"http://127.0.0.1:{listening.getsockname()[1]}/model.onnx"
    assert refusal(one(url)) == f"{url}: the server has stopped sending"
    listening.close()


# ---- this machine ----------------------------------------------------------------------------------------------------


def test_too_little_room_is_said_before_anything_comes(server: Any, own_cache: Path, monkeypatch):
    class Usage:
        free = 1000

    monkeypatch.setattr(transferring.shutil, "disk_usage", lambda folder: Usage)
    assert refusal(one(server.add("/model.onnx", CONTENT))) == (
        f"{own_cache / 'net'} is full: 1 kB free, and 1.05 MB are needed; free some space, or choose another folder "
        "with --to, XDG_CACHE_HOME or HF_HOME; the partial download is kept, and the next one resumes"
    )


def test_a_full_disk_keeps_the_partial_download(server: Any, own_cache: Path, monkeypatch):
    real, room = Path.open, 500_000

    class Full(io.FileIO):
        def write(self, piece: Any) -> int:
            if self.tell() + len(piece) > room:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.name))
            return super().write(piece)

    def opened(self: Path, mode: str = "r", *arguments: Any, **more: Any) -> Any:
        return Full(self, mode) if self.name.endswith(".part") else real(self, mode, *arguments, **more)

    chosen = one(server.add("/model.onnx", CONTENT))
    with monkeypatch.context() as full:
        full.setattr(Path, "open", opened)
        said = refusal(chosen)
    assert said.startswith(f"{own_cache / 'net'} is full: ")
    assert said.endswith("the partial download is kept, and the next one resumes")
    here = (own_cache / "net" / "model.onnx.part").stat().st_size
    assert 0 < here <= room
    fetch(chosen)
    assert server.ranges("/model.onnx") == ["", f"bytes={here}-"]
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT


def test_a_folder_that_may_not_be_written_is_said(server: Any, own_cache: Path, monkeypatch):
    def closed(self: Path, *arguments: Any, **more: Any) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(self))

    monkeypatch.setattr(Path, "mkdir", closed)
    assert refusal(one(server.add("/model.onnx", CONTENT))) == (
        f"{own_cache / 'net'} cannot be written (Read-only file system): choose another folder with --to, "
        "XDG_CACHE_HOME or HF_HOME"
    )
    assert server.asked == []


# ---- licences --------------------------------------------------------------------------------------------------------

NOT_FREE = [
    ({"commercial": False}, "is NOT allowed", []),
    ({"commercial": None}, "is not stated: read the licence", []),
    (
        {"account": True},
        "is allowed",
        ["  account     needed: request access at https://example.org, and log in there"],
    ),
]


@pytest.mark.parametrize(("keys", "use", "account"), NOT_FREE, ids=["non-commercial", "not stated", "gated"])
def test_restricted_weights_are_fetched_only_with_accept_licence(server: Any, keys: dict, use: str, account: list[str]):
    chosen = one(server.add("/model.onnx", CONTENT), license="Own licence", homepage="https://example.org", **keys)
    assert refusal(chosen).splitlines() == [
        "'net' is not downloaded without --accept-licence:",
        "  licence     Own licence",
        f"  commercial  use {use}",
        *account,
        "  homepage    https://example.org",
        "to accept the licence: physic weights fetch net --accept-licence",
    ]
    assert server.asked == []
    assert fetch(chosen, accept=True) == ("model.onnx",)


def test_a_file_of_another_size_is_not_taken_for_the_published_one(server: Any, own_cache: Path):
    chosen = one(server.add("/model.onnx", CONTENT))
    there = own_cache / "net" / "model.onnx"
    there.parent.mkdir(parents=True)
    there.write_bytes(b"cut off")
    assert refusal(chosen) == (
        f"{there} has 7 bytes instead of {len(CONTENT)}, so it is not the published file: move it away, and try again"
    )
    there.unlink()
    assert fetch(chosen) == ("model.onnx",)


# ---- members of a zip ------------------------------------------------------------------------------------------------


def zipped(**members: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name.replace("__", "/"), content)
    return out.getvalue()


def test_members_come_out_of_one_zip_that_is_fetched_once(server: Any, own_cache: Path):
    url = server.add("/all.zip", zipped(x__a=CONTENT, x__b=b"b", other=b"no"))
    both = weights(
        WeightFile("model.onnx", len(CONTENT), HASH, f"{url}#x/a"), WeightFile("deep/b", source=f"{url}#x/b")
    )
    assert fetch(both) == ("model.onnx", "deep/b")
    assert (own_cache / "net" / "model.onnx").read_bytes() == CONTENT
    assert (own_cache / "net" / "deep" / "b").read_bytes() == b"b"
    assert left(own_cache) == ["net/deep/b", "net/model.onnx"]
    assert server.ranges("/all.zip") == [""]


def test_a_zip_is_resumed_too(server: Any, own_cache: Path, no_pause: None):
    content = zipped(a=os.urandom(400_000))
    url = server.add("/all.zip", content, cut=[131_072, 0], etag='"one"')
    chosen = weights(WeightFile("a", source=f"{url}#a"))
    refusal(chosen)
    fetch(chosen)
    assert server.ranges("/all.zip")[-1] == "bytes=131072-"


def test_names_inside_a_zip_decide_no_place(server: Any, own_cache: Path, tmp_path: Path):
    members = {"../../evil": b"evil", "/abs": b"evil", "a": b"a"}
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    url = server.add("/all.zip", out.getvalue())
    before = left(tmp_path)
    assert fetch(weights(WeightFile("model.onnx", source=f"{url}#a"))) == ("model.onnx",)
    assert left(tmp_path) == sorted([*before, "cache/physic/weights/net/model.onnx"])


def test_a_member_that_is_not_there_names_those_that_are(server: Any, own_cache: Path):
    url = server.add("/all.zip", zipped(b=b"b", c=b"c"))
    assert refusal(weights(WeightFile("a", source=f"{url}#a"))) == f"{url} does not contain a, only b, c"
    assert left(own_cache) == []
    server.add("/all.zip", zipped(a=b"a"))  # mended
    assert fetch(weights(WeightFile("a", source=f"{url}#a"))) == ("a",)


def test_a_member_of_another_size_or_hash_is_refused(server: Any, own_cache: Path):
    url = server.add("/all.zip", zipped(a=b"other"))
    assert refusal(weights(WeightFile("a", 7, None, f"{url}#a"))) == (
        f"{url}#a has 5 bytes instead of 7: it has changed"
    )
    assert left(own_cache) == []
    found = hashlib.sha256(b"other").hexdigest()
    assert refusal(weights(WeightFile("a", None, HASH, f"{url}#a"))) == (
        f"{url}#a was extracted, but its SHA-256 is {found} instead of {HASH}: removed"
    )
    assert left(own_cache) == []


def test_a_download_that_is_no_zip_is_reported_and_removed(server: Any, own_cache: Path):
    url = server.add("/all.zip", b"<html>please log in</html>")
    assert refusal(weights(WeightFile("a", source=f"{url}#a"))) == (
        f"{url} is not a readable zip archive (File is not a zip file): removed"
    )
    assert left(own_cache) == []
