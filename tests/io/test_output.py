"""A result is written to a new folder, an empty one, or that of an untouched result, and to no
other.
"""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from physic_core import Reconstruction
from physic_core.errors import OutputError
from physic_core.io.report_file import add_report
from physic_core.io.result_folder import (
    file_digest,
    photo_identity_of_result,
    prepare_result_folder,
)
from physic_core.io.results import save_reconstruction


@pytest.fixture(autouse=True)
def quick_pictures(monkeypatch):
    monkeypatch.setattr("physic_visual.pictures.combined_glb", lambda result: b"mesh")
    monkeypatch.setattr("physic_visual.pictures.preview_png", lambda result: b"\x89PNG")


@pytest.fixture
def out(tmp_path, reconstruction):
    folder = tmp_path / "out"
    save_reconstruction(reconstruction, folder, beside={"a/b.txt": lambda: b"a"})
    return folder


def tree(folder):
    """Return path -> inode, time and size of everything below a folder."""
    return {path: (path.lstat().st_ino, path.lstat().st_mtime_ns) for path in folder.rglob("*")}


def edit(out):
    (out / "preview.png").write_bytes(b"\x89PNg")


def edit_below(out):
    (out / "a" / "b.txt").write_text("b")


def edit_document(out):
    path = out / "reconstruction.json"
    path.write_bytes(path.read_bytes().replace(b'"offset": 1.4', b'"offset": 1.5'))


def delete_document(out):
    (out / "reconstruction.json").unlink()


def replace_document(out):
    (out / "reconstruction.json").write_text('{"schema": "other", "files": {"combined.glb": ""}}')


def add(out):
    (out / "notes.txt").write_text("mine")


def add_hidden(out):
    (out / ".notes").write_text("mine")


def add_folder(out):
    (out / "mine").mkdir()


def add_pipe(out):
    os.mkfifo(out / "pipe")


def link_file(out):
    shutil.copy(out / "preview.png", out.parent / "mine.png")
    (out / "preview.png").unlink()
    (out / "preview.png").symlink_to(out.parent / "mine.png")


def link_folder(out):
    (out / "a").rename(out.parent / "a")
    (out / "a").symlink_to(out.parent / "a")


CHANGES = {
    edit: "preview.png",
    edit_below: "a/b.txt",
    edit_document: "reconstruction.json",
    delete_document: "combined.glb",
    replace_document: "combined.glb",
    add: "notes.txt",
    add_hidden: ".notes",
    add_folder: "mine",
    add_pipe: "pipe",
    link_file: "preview.png",
    link_folder: "a",
}


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_a_foreign_or_edited_file_is_named_and_stays(change, out, reconstruction):
    change(out)
    there = tree(out.parent)
    with pytest.raises(OutputError, match=rf"{out}: {CHANGES[change]} there was not .*-o"):
        save_reconstruction(reconstruction, out, "numbers", overwrite=True)
    assert tree(out.parent) == there


@pytest.mark.parametrize("save", ["numbers", "pictures", "people"])
def test_an_untouched_result_is_replaced_as_a_whole(save, out, reconstruction):
    for name in (".DS_Store", "a/Thumbs.db", "desktop.ini", ".a.0123abcd.physic-part"):
        (out / name).write_text("of the system")
    (out / "combined.glb").unlink()
    out.chmod(0o750)
    paths = save_reconstruction(reconstruction, out, save, beside={"c.txt": lambda: b"c"})
    names = {path.name for path in paths}
    pictures = {"combined.glb", "preview.png"} if save == "pictures" else set()
    assert names == {"reconstruction.json", "reconstruction.npz", "c.txt", *pictures}
    assert {path.name for path in out.iterdir()} == names
    files = json.loads((out / "reconstruction.json").read_text())["files"]
    assert files == {name: file_digest(out / name) for name in names - {"reconstruction.json"}}
    assert (out.stat().st_mode & 0o777, [path.name for path in out.parent.iterdir()]) == (
        0o750,
        ["out"],
    )


def test_new_and_empty_folders_and_links_to_them_will_do(tmp_path, reconstruction):
    (tmp_path / "empty").mkdir()
    (tmp_path / "link").symlink_to("empty")
    for name in ("new/below", "empty", "link"):
        save_reconstruction(reconstruction, tmp_path / name, "numbers")
        assert Reconstruction.load(str(tmp_path / name)).people
    assert (tmp_path / "link").is_symlink()


def test_the_result_of_another_photo_is_replaced_with_overwrite_alone(tmp_path, reconstruction):
    first, other = (replace(reconstruction, photo=f"sha256:{number}") for number in (1, 2))
    out = tmp_path / "out"
    for _ in range(2):
        first.save(str(out), "numbers")
    with pytest.raises(OutputError, match="it holds the result of another photo"):
        other.save(str(out), "numbers")
    save_reconstruction(other, out, "numbers", photos="sha256:1 sha256:2")
    assert photo_identity_of_result(out) == Reconstruction.load(str(out)).photo == "sha256:2"
    first.save(str(out), "numbers", overwrite=True)
    assert photo_identity_of_result(out) == "sha256:1"


def test_the_photo_is_never_replaced(out):
    photo = file_digest(out / "preview.png")
    for photos in (photo, f"sha256:0 {photo}"):
        with pytest.raises(OutputError, match=r"preview\.png there was .* the photo"):
            prepare_result_folder(out, photos, overwrite=True)


def test_a_folder_that_cannot_be_renamed_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("mine")
    for folder, why in (("/proc", "a mount point"), (tmp_path / "file", "a file")):
        with pytest.raises(OutputError, match=why):
            prepare_result_folder(folder, "")
    (tmp_path / "out" / "below").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "out" / "below")
    for folder in (".", ".."):
        with pytest.raises(OutputError, match="the current folder"):
            prepare_result_folder(folder, "")


def test_what_the_user_writes_while_pictures_are_made_is_kept_and_so_is_the_result(
    out, reconstruction, monkeypatch
):
    def mesh(result):
        (out / "notes.txt").write_text("mine")
        return b"mesh"

    monkeypatch.setattr("physic_visual.pictures.combined_glb", mesh)
    with pytest.raises(OutputError, match=r"notes\.txt there was not .* new result is in") as error:
        reconstruction.save(str(out))
    assert (out / "notes.txt").read_text() == "mine"
    assert Reconstruction.load(str(error.value).rpartition(" is in ")[2]).people


@pytest.mark.parametrize("is_edited", [False, True])
def test_a_page_and_exports_that_are_added_are_of_the_result(
    out, reconstruction, is_edited, physic
):
    for _ in range(2):
        add_report(out)
    assert physic("export", out, "--to", "colmap").exit_code == 0
    assert physic("export", out, "--to", "ply").exit_code == 0
    if is_edited:
        page = out / "report.html"
        page.write_text(page.read_text(encoding="utf-8") + "my remarks", encoding="utf-8")
        for write in (add_report, lambda out: reconstruction.save(str(out))):
            with pytest.raises(OutputError, match="edited"):
                write(out)
        assert page.read_text(encoding="utf-8").endswith("my remarks")
    else:
        reconstruction.save(str(out), "numbers")
        assert len(list(out.iterdir())) == 2


def test_a_document_of_the_user_in_place_of_a_folder_or_link_is_refused(out, reconstruction):
    document = out / "reconstruction.json"
    content = document.read_bytes()
    for make in (Path.mkdir, lambda path: path.symlink_to(out.parent / "mine.json")):
        document.unlink() if document.is_file() else document.rmdir()
        (out.parent / "mine.json").write_bytes(content)
        make(document)
        with pytest.raises(OutputError, match="there was not written by a run"):
            save_reconstruction(reconstruction, out, "numbers")
