"""A name in somebody else's folder that leads out of it is neither read nor written."""

from __future__ import annotations

import base64
import json
import os

import pytest
from click.testing import CliRunner
from PIL import Image

from physic_batch.contact_sheet import find_results, thumbnail_path, write_thumbnail
from physic_batch.photo_processor import BatchJob, PhotoProcessor
from physic_batch.photos import list_photos, photo_folder
from physic_core import load_reconstruction, save_reconstruction
from physic_core.cli import main
from physic_core.configuration.model import load_config
from physic_core.errors import InputError, OutputError
from tests.rooms import tiny_result

SECRET = b"TOKEN=0123456789abcdef0123456789abcdef"
ROW = {"id": "a", "state": "done", "config": "", "finished": "", "path": "/a.jpg", "run": 1}


def physic(*arguments):
    return CliRunner().invoke(main, list(map(str, arguments)))


def write_journal(out, **row):
    out.mkdir(exist_ok=True)
    with (out / "journal.jsonl").open("a") as file:
        file.write(json.dumps({**ROW, **row}) + "\n")


@pytest.fixture
def home(tmp_path):
    """A folder of the user's with a secret, a picture and a result."""
    home = tmp_path / "home"
    save_reconstruction(tiny_result(1), home / "result", "numbers")
    (home / "secret.txt").write_bytes(SECRET)
    (home / "report.html").write_bytes(SECRET)
    Image.new("RGB", (64, 64), "red").save(home / "private.jpg")
    return home


THUMBNAIL = thumbnail_path(photo_folder("a"))


@pytest.mark.parametrize(
    ("link", "target"),
    [
        (THUMBNAIL, "/proc/self/environ"),
        (THUMBNAIL, "{}/private.jpg"),
        (os.path.dirname(THUMBNAIL), "{}"),
        ("thumbnails", "{}"),
        ("photos", "{}"),
        ("photos/3f", "{}"),
        ("photos/3f/report.html", "{}/report.html"),
    ],
)
def test_a_sheet_neither_embeds_nor_links_what_lies_outside(link, target, home, tmp_path):
    out = tmp_path / "out"
    write_journal(out, folder="photos/3f")
    (out / link).parent.mkdir(parents=True, exist_ok=True)
    (out / link).symlink_to(target.format(home))
    for inside in (os.path.basename(THUMBNAIL), os.path.relpath(THUMBNAIL, "thumbnails")):
        (home / inside).parent.mkdir(exist_ok=True)
        (home / inside).write_bytes((home / "private.jpg").read_bytes())
    assert physic("report", out).exit_code == 0
    page = (out / "contact-sheet.html").read_text()
    assert '"thumbnail": ""' in page
    assert '"link": ""' in page


@pytest.mark.parametrize("content", [SECRET, b"\xff\xd8\xff" + SECRET, b""])
def test_a_sheet_embeds_only_what_decodes_as_a_jpeg(content, tmp_path):
    write_journal(tmp_path / "out")
    path = tmp_path / "out" / THUMBNAIL
    path.parent.mkdir(parents=True)
    path.write_bytes(content)
    assert physic("report", tmp_path / "out").exit_code == 0
    assert '"thumbnail": ""' in (tmp_path / "out" / "contact-sheet.html").read_text()
    Image.new("RGB", (64, 64)).save(path, icc_profile=bytes(1 << 20))
    assert physic("report", tmp_path / "out").exit_code == 0
    assert '"thumbnail": ""' in (tmp_path / "out" / "contact-sheet.html").read_text()
    Image.new("RGB", (64, 64)).save(path)
    assert physic("report", tmp_path / "out").exit_code == 0
    thumbnail = base64.b64encode(path.read_bytes()).decode()
    assert thumbnail in (tmp_path / "out" / "contact-sheet.html").read_text()


@pytest.mark.parametrize("name", ["reconstruction.json", "reconstruction.npz"])
def test_a_result_whose_file_is_a_link_that_leads_out_is_not_read(name, home, tmp_path):
    folder = tmp_path / "theirs"
    folder.mkdir()
    for each in ("reconstruction.json", "reconstruction.npz"):
        (folder / each).write_bytes((home / "result" / each).read_bytes())
    assert load_reconstruction(folder).people
    (folder / name).unlink()
    (folder / name).symlink_to(home / "result" / name)
    with pytest.raises(InputError, match="leads out"):
        load_reconstruction(folder)
    assert physic("report", tmp_path / "theirs").exit_code != 0
    assert not (folder / "report.html").is_file() or len((folder / "report.html").read_text()) < 1e5


def test_links_within_the_folder_and_of_the_folder_itself_are_followed(home, tmp_path):
    (home / "result" / "reconstruction.npz").rename(home / "result" / "arrays")
    (home / "result" / "reconstruction.npz").symlink_to("arrays")
    (tmp_path / "short").symlink_to(home / "result")
    assert load_reconstruction(tmp_path / "short").people


@pytest.mark.parametrize("name", ["photos", "thumbnails", "logs"])
def test_a_batch_writes_nothing_through_a_link_that_leads_out(name, home, tmp_path):
    (tmp_path / "photo.jpg").write_text("no photo")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).symlink_to(home)
    before = sorted(home.rglob("*"))
    done = physic("batch", tmp_path / "photo.jpg", "-o", tmp_path / "out", "--preset", "mock")
    assert (done.exit_code, f"{name}: a link" in done.stderr) == (2, True)
    assert sorted(home.rglob("*")) == before


def test_a_photo_whose_folder_is_a_link_that_leads_out_fails(home, tmp_path):
    out = tmp_path / "out"
    job = BatchJob(load_config(preset="mock"), str(out), "numbers", with_thumbnails=False)
    Image.new("RGB", (64, 64)).save(tmp_path / "photo.png")
    (item,) = list_photos([str(tmp_path / "photo.png")]).photos
    place = out / photo_folder(item.id)
    place.parent.parent.mkdir(parents=True)
    place.parent.symlink_to(home)
    before = sorted(home.rglob("*"))
    row = PhotoProcessor(job, lambda *_: tiny_result(1))(item)
    assert (row["state"], row["error"]) == ("failed", "OutputError")
    with pytest.raises(OutputError, match="leads out"):
        write_thumbnail(tiny_result(1), home, "photos/../../x")
    assert sorted(home.rglob("*")) == before


@pytest.mark.parametrize("document", ["", "{}", "[]", '[{"cameras": {}, "shots": {}}]', "{"])
def test_a_file_of_another_program_makes_no_folder_one_of_a_result(document, tmp_path):
    for name in ("a.jpg", "below/b.jpg", "below/further/c.jpg", "thumbnails/3f/d.jpg"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "reconstruction.json").write_text(document)
    (tmp_path / "journal.jsonl").write_text(document)
    (tmp_path / "below" / ".reconstruction.json.0.physic-document").write_text(document)
    listed = list_photos([str(tmp_path)])
    assert (len(listed.photos), listed.left_out_in_words()) == (4, "1 .json, 1 .jsonl, 1 hidden")
    with pytest.raises(InputError, match="no result"):
        find_results(tmp_path / "below")
