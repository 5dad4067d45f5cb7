"""What writing a result replaces: an earlier result of its photo, and nothing of the user's."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace

import pytest

from physic_core import Reconstruction
from physic_core.errors import OutputError
from physic_core.io.result_folder import (
    FILES,
    Replaceable,
    file_digest,
    photo_identity_of_result,
)
from physic_core.io.result_folder import check_overwrite as check
from physic_core.io.results import save_reconstruction


@pytest.fixture(autouse=True)
def quick_pictures(monkeypatch):
    monkeypatch.setattr("physic_visual.pictures.combined_glb", lambda result: b"mesh")
    monkeypatch.setattr("physic_visual.pictures.preview_png", lambda result: b"\x89PNG")


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "photo.png"
    path.write_bytes(b"a photo")
    return path


@pytest.fixture
def out(tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def check_overwrite(folder, photo, *, overwrite=False):
    check(folder, Replaceable(photo, overwrite), FILES)


def refusal(folder, photo, **settings):
    with pytest.raises(OutputError) as caught:
        check_overwrite(folder, photo, **settings)
    start = f"cannot write results to {folder}: "
    assert str(caught.value).startswith(start)
    return str(caught.value).removeprefix(start)


def test_a_new_folder_an_empty_one_and_one_with_other_files_will_do(out, photo):
    check_overwrite(out / "new", file_digest(photo))
    check_overwrite(out, file_digest(photo))
    (out / "notes.txt").write_text("mine")
    (out / "photo.png").write_bytes(photo.read_bytes())
    check_overwrite(out, file_digest(photo))


@pytest.mark.parametrize(
    "place", [shutil.copy, os.link, os.symlink], ids=lambda place: place.__name__
)
@pytest.mark.parametrize("overwrite", [False, True])
def test_the_photo_is_never_overwritten(out, photo, place, overwrite):
    place(photo, out / "preview.png")
    for photos in (file_digest(photo), f"sha256:0 {file_digest(photo)}"):
        assert "preview.png there is the photo itself" in refusal(out, photos, overwrite=overwrite)


def test_every_foreign_file_is_named_at_once(out, photo):
    shutil.copy(photo, out / "preview.png")
    (out / "combined.glb").write_text("mine")
    (out / "people.csv").mkdir()
    message = refusal(out, file_digest(photo), overwrite=True)
    assert (
        "preview.png there is the photo itself; combined.glb, people.csv there are not" in message
    )


@pytest.mark.parametrize(
    "text", ["{}", "a letter", "[" * 100_000, '{"schema": "other", "files": {"combined.glb": ""}}']
)
def test_another_document_makes_no_result(out, photo, text):
    (out / "reconstruction.json").write_text(text)
    (out / "combined.glb").write_text("mine")
    assert photo_identity_of_result(out) is None
    assert refusal(out, file_digest(photo), overwrite=True).startswith(
        "reconstruction.json, combined.glb there are not of an earlier run: "
    )


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_named_pipe_does_not_block(out, photo):
    os.mkfifo(out / "combined.glb")
    assert "combined.glb there is not of an earlier run" in refusal(out, file_digest(photo))
    assert (
        file_digest(out / "combined.glb") == file_digest(out) == file_digest(out / "nothing") == ""
    )


def test_saving_replaces_the_same_photos_result_alone(out, reconstruction):
    first, other = (replace(reconstruction, photo=f"sha256:{number}") for number in (1, 2))
    for _ in range(2):
        first.save(str(out), "numbers")
    with pytest.raises(OutputError, match="it holds the result of another photo"):
        other.save(str(out), "numbers")
    assert photo_identity_of_result(out) == Reconstruction.load(str(out)).photo == "sha256:1"
    other.save(str(out), "numbers", overwrite=True)
    assert photo_identity_of_result(out) == "sha256:2"
    (out / "preview.png").write_text("mine")
    with pytest.raises(OutputError, match=r"preview\.png there is not of an earlier run"):
        other.save(str(out), overwrite=True)
    other.save(str(out), "numbers")
    assert (out / "preview.png").read_text() == "mine"


def edited(path):
    path.write_text("mine")


def to_a_link(path):
    path.unlink()
    path.symlink_to("nowhere")


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("change", [edited, to_a_link], ids=lambda change: change.__name__)
def test_an_edited_file_and_a_link_are_kept_beside_the_new_one(
    out, reconstruction, change, overwrite
):
    reconstruction.save(str(out))
    for number in ("", "-2"):
        change(out / "preview.png")
        before = os.lstat(out / "preview.png")
        reconstruction.save(str(out), overwrite=overwrite)
        assert os.path.samestat(before, os.lstat(out / f"preview.edited{number}.png"))
        assert (out / "preview.png").read_bytes().startswith(b"\x89PNG")
        assert not (out / "preview.png").is_symlink()
    reconstruction.save(str(out))
    assert len(list(out.glob("*.edited*"))) == 2


NUMBERS = {"reconstruction.json", "reconstruction.npz"}
SAVED = {
    "people": NUMBERS,
    "numbers": NUMBERS,
    "pictures": {*NUMBERS, "combined.glb", "preview.png"},
}


@pytest.mark.parametrize("save", SAVED)
def test_a_saved_result_has_exactly_its_files_and_states_their_digests(out, reconstruction, save):
    reconstruction.save(str(out))
    (out / "notes.txt").write_text("mine")
    for _ in range(2):
        paths = save_reconstruction(reconstruction, out, save, beside={"a.txt": b"a"})
        names = {path.name for path in paths}
        assert names == SAVED[save] | {"a.txt"}
        assert {path.name for path in out.iterdir()} == names | {"notes.txt"}
    files = json.loads((out / "reconstruction.json").read_text())["files"]
    assert files == {name: file_digest(out / name) for name in names - {"reconstruction.json"}}


def test_an_edited_file_that_the_next_result_has_not_is_kept_too(out, reconstruction):
    reconstruction.save(str(out))
    (out / "combined.glb").write_text("mine")
    reconstruction.save(str(out), "numbers")
    assert (out / "combined.edited.glb").read_text() == "mine"
    assert {path.name for path in out.iterdir()} == NUMBERS | {"combined.edited.glb"}


@pytest.mark.parametrize("is_link", [True, False])
def test_a_link_or_folder_in_place_of_the_document_is_of_the_user(out, reconstruction, is_link):
    save_reconstruction(reconstruction, out, "numbers")
    document = out / "reconstruction.json"
    document.rename(out / "mine.json")
    if is_link:
        document.symlink_to("mine.json")
    else:
        document.mkdir()
    for earlier in ((), ("reconstruction.json", "reconstruction.npz")):
        with pytest.raises(OutputError, match=r"reconstruction\.json.* not of an earlier run"):
            save_reconstruction(reconstruction, out, "numbers", earlier=earlier)
    assert (document.is_symlink(), document.is_dir()) == (is_link, not is_link)


def test_a_file_that_the_user_writes_while_pictures_are_made_is_kept(
    out, reconstruction, monkeypatch
):
    def mesh(result):
        (out / "combined.glb").write_text("mine")
        return b"mesh"

    monkeypatch.setattr("physic_visual.pictures.combined_glb", mesh)
    with pytest.raises(OutputError, match=r"combined\.glb there is not of an earlier run"):
        reconstruction.save(str(out))
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [("combined.glb", "mine")]
