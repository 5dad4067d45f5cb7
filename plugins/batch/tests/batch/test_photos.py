"""Which photos a batch has, what their ids and folders are, and that shards cover each once."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PIL import Image

from physic_batch.photos import PhotoItem, Shard, list_photos, photo_folder, photo_of_row
from physic_core import export_reconstruction, save_reconstruction
from physic_core.errors import ConfigError, InputError
from physic_core.files import MARK
from tests.rooms import tiny_result


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in (
        "b.jpg",
        "a.PNG",
        "deep/er/c.webp",
        "deep/.hidden.jpg",
        ".trash/d.jpg",
        "notes.dat",
    ):
        path = tmp_path / "photos" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    monkeypatch.chdir(tmp_path)
    return tmp_path / "photos"


def names(items):
    return [Path(item.path).name for item in items]


def test_files_and_folders_give_each_photo_once(folder):
    assert names(list_photos(["photos/b.jpg", "photos/deep", "photos"]).photos) == [
        "b.jpg",
        "c.webp",
        "a.PNG",
    ]
    assert names(list_photos(["photos/notes.dat"]).photos) == ["notes.dat"]
    assert list_photos(["photos/b.jpg"]).photos == list_photos([str(folder / "b.jpg")]).photos


def test_a_table_gives_cameras_statures_ages_and_ids(folder):
    (folder / "table.csv").write_text(
        "path, camera, stature, age, id\n"
        'b.jpg, "900,910,320,240",1.8,,first\na.PNG,700,"1.8,1.6","0,7.5",\ndeep/er/c.webp,,,,\n'
    )
    first, second, third = list_photos([str(folder / "table.csv")]).photos
    assert first == PhotoItem(
        "first",
        str(folder / "b.jpg"),
        {"intrinsics": [900.0, 910.0, 320.0, 240.0], "stature": [1.8]},
    )
    assert second.settings == {"focal_px": 700.0, "stature": [1.8, 1.6], "age": [0.0, 7.5]}
    assert (second.id, third.settings) == (PhotoItem.at(folder / "a.PNG").id, {})


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("", "lacks path"),
        ("file\nb.jpg\n", "column 'file' is none of path"),
        ("path,id\n,x\n", "row 1: the column 'path'"),
        ("path,camera\nb.jpg,wide\n", "row 1: a camera .*'wide'"),
        ("path,id\nb.jpg,x\na.PNG,x\n", "an id of its own"),
        ("path,stature\nb.jpg,1.7\na.PNG,170\n", "row 2: stature.*170"),
        ("path,camera\nb.jpg,0.1\n", "row 1: focal_px: .*0.1"),
        ("path,age\nb.jpg,old\n", "row 1: ages .*'old'"),
        ("path,id\nb.jpg,1,2\n", "row 1 has more cells"),
        ("path,stature,stature\nb.jpg,1.7,1.8\n", "'stature' is there twice"),
        ('path,stature\nb.jpg,"1,7"\n', "with a point, as 1.7"),
        ("path;stature\nb.jpg;1,7\n", "semicolons: save it as CSV with commas"),
        ("path\tstature\nb.jpg\t1.7\n", "tabs: save it as CSV with commas"),
        ("path\nb\0.jpg\n", "row 1: a path .*null"),
        ("path\n" + "x" * 200_000, "field larger than field limit"),
    ],
)
def test_a_table_with_faults_is_an_error(folder, rows, message):
    (folder / "table.csv").write_text(rows)
    with pytest.raises(InputError, match=message):
        list_photos([str(folder / "table.csv")])


@pytest.mark.parametrize("name", ["nowhere/a.jpg", "head.csv"])
def test_a_name_or_a_table_without_photos_is_an_error(folder, name):
    Path("head.csv").write_text("path,id\n")
    with pytest.raises(InputError, match=f"no photos .*{re.escape(name)}"):
        list_photos([name])


def test_a_folder_can_be_that_of_its_results(tmp_path):
    mine = ("a.jpg", "photos/b.jpg", "thumbnails/c.jpg")
    for name in (*mine, "journal.jsonl", "thumbnails/3f/a.jpg"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(MARK if "3f" in name else "mine")
    save_reconstruction(tiny_result(), tmp_path / "photos" / "3f" / "a", "numbers")
    listed = list_photos([str(tmp_path)])
    assert names(listed.photos) == ["a.jpg", "b.jpg", "c.jpg"]
    assert listed.left_out_in_words() == (
        "2 in folders of results, 1 .jsonl, 1 thumbnails and exports"
    )


@pytest.mark.parametrize("name", ["obj", "colmap", "depth"])
def test_pictures_of_exports_are_no_photos(name, tmp_path):
    Image.new("RGB", (8, 8)).save(tmp_path / "mine.png")
    Image.new("RGB", (8, 8)).save(tmp_path / "mine.jpg")
    done = export_reconstruction(tiny_result(), tmp_path, name)
    pictures = [path for path in done.files if path.suffix in (".png", ".jpg")]
    for path in pictures:
        with Image.open(path) as picture:
            picture.load()
    assert pictures
    assert names(list_photos([str(tmp_path)]).photos) == ["mine.jpg", "mine.png"]


def test_files_that_are_no_photos_are_skipped(folder):
    for name in ("Thumbs.db", "more.txt", "README"):
        (folder / name).touch()
    for name in (
        "b-physic/reconstruction.json",
        "b-physic/preview.png",
        "old/journal-1-of-2.jsonl",
    ):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text('{"schema": "physic-reconstruction"}')
    (folder / "old" / "thumbnails" / "3f").mkdir(parents=True)
    (folder / "old" / "thumbnails" / "3f" / "b.jpg").write_text(MARK)
    listed = list_photos(["photos"])
    assert names(listed.photos) == ["a.PNG", "b.jpg", "c.webp"]
    assert sum(listed.left_out.values()) == 9
    assert names(list_photos(["photos/b-physic/preview.png"]).photos) == ["preview.png"]
    with pytest.raises(InputError, match=r"left out: 1 \.jsonl, 1 thumbnails and exports"):
        list_photos(["photos/old"])


UNREADABLE = """
import os, sys
from physic_batch.photos import list_photos
from physic_core.errors import InputError
if os.geteuid() == 0:
    os.seteuid(65534)  # root may read everything
try:
    print(list_photos([sys.argv[1]]).photos)
except InputError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="permissions")
@pytest.mark.parametrize("asked", ["photos", "photos/locked"])
def test_a_folder_that_cannot_be_read_is_an_error(tmp_path, asked):
    (tmp_path / "photos" / "locked").mkdir(parents=True)
    (tmp_path / "photos" / "a.jpg").touch()
    (tmp_path / "photos" / "locked" / "a.jpg").touch()
    (tmp_path / "photos" / "locked").chmod(0)
    tmp_path.chmod(0o755)  # that of pytest is open to its owner alone
    command = [sys.executable, "-c", UNREADABLE, asked]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "photos/locked: Permission denied" in done.stdout


@settings(max_examples=20)
@example("x" * 300)
@given(st.text(min_size=1, max_size=300))
def test_every_id_is_a_valid_folder_name(item):
    head, prefix, name = photo_folder(item.replace("\0", "")).split("/")
    assert (head, len(prefix)) == ("photos", 2)
    assert name not in ("", ".", "..")
    assert len(os.fsencode(name)) <= 255


@given(st.lists(st.text(min_size=1), min_size=1, max_size=50), st.integers(1, 20))
def test_shards_cover_every_photo_once(items, count):
    for item in items:
        assert sum(item in Shard(shard, count) for shard in range(1, count + 1)) == 1


def test_the_shard_of_a_photo_is_the_same_in_every_version():
    shards = {
        item: next(k for k in range(1, 8) if item in Shard(k, 7)) for item in ("IMG_1", "a/b", "ü")
    }
    assert shards == {"IMG_1": 3, "a/b": 2, "ü": 5}


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3"])
def test_invalid_shards_are_an_error(text):
    assert Shard.parse("3/16") == Shard(3, 16)
    with pytest.raises(ConfigError, match="a shard is written 3/16"):
        Shard.parse(text)


def test_a_row_names_people_to_leave_out():
    assert photo_of_row({"path": "a.jpg", "ignore": "3,4, 5,6"}).settings == {
        "ignore": [(3.0, 4.0), (5.0, 6.0)]
    }
    for cell in ("3", "3,4,5", "left"):
        with pytest.raises(ValueError, match="pixels x,y"):
            photo_of_row({"path": "a.jpg", "ignore": cell})
