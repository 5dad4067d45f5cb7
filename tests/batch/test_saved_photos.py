"""What a batch keeps of a photo: how large it is, what it loses, and the table and page about all photos."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physic_core import Reconstruction, load_people, load_reconstruction, save_reconstruction
from physic_core.batch.contact_sheet import write_contact_sheet
from physic_core.batch.journal import COLUMNS, Journal
from physic_core.batch.photos import PhotoItem, photo_folder
from physic_core.batch.process import BatchJob, PhotoProcessor, failed_row
from physic_core.batch.table import write_people_table, write_table
from physic_core.configuration.model import load_config
from physic_core.errors import ConfigError, InputError
from physic_core.io.saved_files import Saving


@pytest.fixture
def result(make: Callable[..., Reconstruction]) -> Reconstruction:
    """On rays, as results of the engine are, with the noise of a photo."""
    made, rng = make(320, 240), np.random.default_rng(0)
    z = made.scene.points[..., 2].astype(np.float32)
    K = made.intrinsics
    x = (np.arange(320) - K.cx) / K.fx
    y = (np.arange(240) - K.cy) / K.fy
    points = np.stack([z * x, z * y[:, None], z], -1).astype(np.float32)
    image = rng.integers(0, 256, made.image.shape, dtype=np.uint8)
    colors = np.where(made.people[0].mask[..., None], made.scene.colors, image)
    return replace(made, image=image, scene=replace(made.scene, points=points, colors=colors))


def test_compact_arrays_lose_less_than_a_tenth_of_a_millimetre(result: Reconstruction, tmp_path: Path):
    save_reconstruction(result, tmp_path / "small", "numbers")
    again = load_reconstruction(tmp_path / "small")
    z = result.scene.points[..., 2]
    valid = result.scene.valid
    error = np.abs(again.scene.points - result.scene.points).max(-1)[valid] / z[valid]
    assert error.max() < 2e-5  # 0.06 mm at 3 m
    for one, other in zip(again.people, result.people, strict=True):
        assert np.abs(one.vertices - other.vertices).max() < 4e-5
        assert np.abs(one.joints - other.joints).max() < 4e-5
        assert np.array_equal(one.contact, other.contact)
        assert np.array_equal(one.mask, other.mask)
        assert np.array_equal(one.keypoints, other.keypoints)
        near = np.abs(other.distance) < 0.1
        assert np.array_equal(np.isinf(one.distance), np.isinf(other.distance))
        assert np.abs(one.distance[near] - other.distance[near]).max() < 4e-5
    assert np.array_equal(again.image, result.image)
    assert np.array_equal(again.scene.colors, result.scene.colors)
    cosine = (again.scene.normals * result.scene.normals).sum(-1)[np.abs(result.scene.normals).any(-1)]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.4


@pytest.mark.parametrize(
    ("saving", "files"),
    [
        (Saving("numbers"), ["reconstruction.json", "reconstruction.npz"]),
        (Saving.parse("numbers+preview"), ["reconstruction.json", "reconstruction.npz", "preview.png"]),
        (Saving("compact"), ["reconstruction.json", "reconstruction.npz", "preview.png", "combined.glb"]),
        (Saving("people"), ["reconstruction.json", "people.npz"]),
        (Saving("summary"), []),
        (Saving.parse("summary+preview"), ["preview.png"]),
        (
            Saving("full"),
            ["reconstruction.json", "reconstruction.npz", "preview.png", "scene.glb", "combined.glb", "person_0.glb",
             "person_1.glb"],
        ),
    ],
    ids=str,
)  # fmt: skip
def test_save_levels_write_these_files(result: Reconstruction, tmp_path: Path, saving: Saving, files: list[str]):
    save_reconstruction(result, tmp_path / "photo", saving, overwrite=True)
    save_reconstruction(result, tmp_path / "photo", saving, overwrite=True)
    assert {path.name for path in tmp_path.glob("photo/*")} == set(files)
    assert not saving.main_file or saving.main_file in files


def test_people_are_arrays_that_numpy_reads_too(result: Reconstruction, tmp_path: Path):
    save_reconstruction(result, tmp_path, Saving("people"), overwrite=True)
    arrays = load_people(tmp_path)
    assert np.abs(arrays["person_1_vertices"] - result.people[1].vertices).max() < 4e-5
    assert arrays["person_1_distance"].dtype == np.float32
    assert {"faces", "intrinsics", "person_0_body_pose"} <= set(arrays)
    assert not [name for name in arrays if name.startswith("scene")]
    with np.load(tmp_path / "people.npz") as stored:
        assert set(stored) == set(arrays)


def test_a_result_names_the_function_that_reads_it(result: Reconstruction, tmp_path: Path):
    save_reconstruction(result, tmp_path / "people", Saving("people"), overwrite=True)
    save_reconstruction(result, tmp_path / "numbers", Saving("numbers"), overwrite=True)
    with pytest.raises(InputError) as error:
        load_reconstruction(tmp_path / "people")
    assert str(error.value) == (
        f"cannot read {tmp_path / 'people' / 'reconstruction.npz'}: this result was saved as people.npz; "
        "physic_core.load_people reads it"
    )
    with pytest.raises(InputError, match=r"saved as reconstruction\.npz; physic_core\.load_reconstruction reads it$"):
        load_people(tmp_path / "numbers")


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("everything", "what to save must begin with one of full, exact, compact, numbers, people, summary"),
        ("numbers+page", "preview, glb, report can be added to what to save (got page)"),
        ("people+glb", "GLB files need the scene: save full, exact, compact or numbers (got 'people+glb')"),
    ],
)
def test_words_that_name_no_files_are_refused(words: str, problem: str):
    with pytest.raises(ConfigError, match=re.escape(problem)):
        Saving.parse(words)


def test_the_word_of_the_files_is_read_back():
    for words in ("full", "exact+preview+glb", "numbers+report", "summary+preview"):
        assert str(Saving.parse(words)) == words
    assert str(Saving.parse("numbers+report+preview")) == "numbers+preview+report"


# ---- rows, table and page --------------------------------------------------------------------------------------------


@pytest.fixture
def batch(result: Reconstruction, tmp_path: Path) -> Path:
    """Two photos that are done and one that failed."""
    out = tmp_path / "batch"
    out.mkdir()

    def reconstruct(path: str, settings: Any) -> Reconstruction:
        if "bad" in path:
            raise InputError(f"cannot read the photo {path}: </script><b>&")
        return result

    process = PhotoProcessor(BatchJob(load_config(preset="mock"), str(out), "people"), reconstruct)
    with Journal(out / "journal.jsonl") as journal:
        for name in ("one", "bad", "two"):
            journal.append(process(PhotoItem(name, f"/photos/{name}.jpg")))
    return out


def test_a_foreign_file_in_the_folder_of_a_photo_fails_only_that_photo(result: Reconstruction, tmp_path: Path):
    folder = tmp_path / photo_folder("one")
    folder.mkdir(parents=True)
    job = BatchJob(load_config(preset="mock"), str(tmp_path), "numbers")
    (folder / "reconstruction.json").write_text("mine too")
    row = PhotoProcessor(job, lambda path, settings: result)(PhotoItem("one", "/photos/one.jpg"))
    assert (row["state"], row["error"]) == ("failed", "OutputError")
    assert row["message"] == (
        f"cannot write results to {folder}: reconstruction.json there is not of an earlier run: name another folder, "
        "or move it away"
    )
    assert (folder / "reconstruction.json").read_text() == "mine too"


def test_the_table_has_a_row_for_each_photo(batch: Path):
    with write_table(batch, "csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["id"], row["state"], row["people"]) for row in rows] == [
        ("one", "done", "2"),
        ("bad", "failed", ""),
        ("two", "done", "2"),
    ]
    assert list(rows[0])[: len(COLUMNS)] == list(COLUMNS)
    assert rows[0]["folder"] == photo_folder("one")


def people_of(out: Path) -> list[tuple[str, str]]:
    with write_people_table(out).open(newline="", encoding="utf-8") as file:
        return [(row["photo"], row["person"]) for row in csv.DictReader(file)]


def test_each_person_has_a_row_in_the_order_of_the_photos(batch: Path, result: Reconstruction):
    expected = [("one", "0"), ("one", "1"), ("two", "0"), ("two", "1")]
    assert people_of(batch) == expected
    again = replace(result, people=result.people[:1])
    process = PhotoProcessor(BatchJob(load_config(preset="mock"), str(batch), "summary"), lambda *_: again)
    with Journal(batch / "journal.jsonl") as journal:
        for name in ("one", "=3"):
            journal.append(process(PhotoItem(name, f"/photos/{name}.jpg")))
    assert people_of(batch) == [*expected[2:], ("one", "0"), ("'=3", "0")]
    with write_table(batch, "csv").open(newline="") as file:
        assert not {"people_rows"} & set(next(csv.reader(file)))


def test_no_text_of_the_csv_table_is_a_formula(tmp_path: Path):
    ids = ["=cmd|'calc'!A0", "@SUM(1)", "-o", "+1", "\tx", "\rx", "\nx", "\uff1d1", "'quoted", "plain", "a=b"]
    job = BatchJob(load_config(preset="mock"), str(tmp_path), "summary", thumbnails=False)
    with Journal(tmp_path / "journal.jsonl") as journal:
        for name in ids:
            journal.append(failed_row(job, PhotoItem(name, f"/photos/{name}"), "InputError", "=1+1", 0.0))
    with write_table(tmp_path, "csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert not [
        text
        for row in rows
        for text in row.values()
        if text.startswith(("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d"))
    ]
    assert [row["id"].removeprefix("'") for row in rows] == ids
    assert [row["id"][0] == "'" for row in rows] == [True] * 9 + [False] * 2
    assert {row["message"] for row in rows} == {"'=1+1"}
    if find_spec("pyarrow"):
        assert parquet_column(write_table(tmp_path, "parquet"), "id") == ids


def parquet_column(path: Path, name: str) -> list[Any]:
    import pyarrow.parquet

    values: list[Any] = pyarrow.parquet.read_table(path)[name].to_pylist()
    return values


def test_the_parquet_table_equals_the_csv(batch: Path):
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(write_table(batch, "parquet")).to_pydict()
    assert table["id"] == ["one", "bad", "two"]
    assert table["people"] == [2.0, None, 2.0]
    assert table["error"] == ["", "InputError", ""]


def test_without_pyarrow_a_parquet_table_is_refused(batch: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    with pytest.raises(ConfigError) as error:
        write_table(batch, "parquet")
    assert str(error.value) == ("summary.parquet needs pyarrow: pip install pyarrow, or use a CSV file (--table csv)")


def test_the_contact_sheet_is_one_file_that_needs_no_network(batch: Path):
    page = write_contact_sheet(batch).read_text()
    assert not re.search(r"https?:|src=\"(?!data:)|@import|url\(", page)
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    cards = json.loads(data[1])
    assert [(card["name"], card["state"], card["people"]) for card in cards] == [
        ("one", "done", 2),
        ("bad", "failed", None),
        ("two", "done", 2),
    ]
    assert cards[0]["thumbnail"].startswith("/9j/")
    assert len(cards[0]["thumbnail"]) < 40_000
    assert [card["title"] for card in cards] == ["one.jpg", "bad.jpg", "two.jpg"]
    assert cards[1]["message"] == "cannot read the photo bad.jpg: </script><b>&"
    assert (batch / cards[0]["link"] / "people.npz").is_file()


def test_a_result_without_its_thumbnail_stays_on_the_page(result: Reconstruction, tmp_path: Path):
    job = BatchJob(load_config(preset="mock"), str(tmp_path), "numbers")
    with Journal(tmp_path / "journal.jsonl") as journal:
        journal.append(PhotoProcessor(job, lambda path, settings: result)(PhotoItem("a", "/photos/a.jpg")))
    (thumbnail,) = tmp_path.glob("thumbnails/*/a.jpg")
    thumbnail.unlink()
    assert '"thumbnail": "", "state": "done"' in write_contact_sheet(tmp_path).read_text()
