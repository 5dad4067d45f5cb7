"""What a batch keeps of a photo: how large it is, what it loses, and the table and page about all
photos.
"""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace

import pytest

from physic_batch.contact_sheet import write_contact_sheet
from physic_batch.journal import Journal, write_tables
from physic_batch.photo_processor import BatchJob, PhotoProcessor, failed_row
from physic_batch.photos import PhotoItem
from physic_core.configuration.model import load_config
from physic_core.errors import InputError
from physic_core.io.results import read_record


@pytest.fixture
def result(make):
    return make(320, 240)


# ---- rows, table and page
# --------------------------------------------------------------------------------------------


@pytest.fixture
def batch(result, tmp_path):
    """Two photos that are done and one that failed."""
    out = tmp_path / "batch"
    out.mkdir()

    def reconstruct(path, settings):
        if "bad" in path:
            raise InputError(f"cannot read the photo {path}: </script><b>&")
        return result

    process = PhotoProcessor(BatchJob(load_config(preset="mock"), str(out), "people"), reconstruct)
    with Journal(out / "journal.jsonl") as journal:
        for name in ("one", "bad", "two"):
            journal.append(process(PhotoItem(name, f"/photos/{name}.jpg")))
    return out


@pytest.mark.parametrize(
    "part",
    [
        "physic_batch.photo_processor.write_thumbnail",
        "physic_batch.photo_processor.person_rows",
        "physic_core.types.Reconstruction.summary",
    ],
)
def test_what_fails_beyond_the_answer_is_a_warning_of_the_photo(
    result, tmp_path, part, monkeypatch
):
    monkeypatch.setattr(part, lambda *_: 1 / 0)
    job = BatchJob(load_config(preset="mock"), str(tmp_path), "people")
    row = PhotoProcessor(job, lambda *_: result)(PhotoItem("one", "/photos/one.jpg"))
    assert row["state"] == "done"
    record = read_record(tmp_path / row["folder"])
    assert sum("failed: ZeroDivisionError" in text for text in record.warnings) == 1
    with Journal(tmp_path / "journal.jsonl") as journal:
        journal.append(row)
    assert all(path.stat().st_size for path in write_tables(tmp_path))


def people_of(out):
    with write_tables(out)[1].open(newline="", encoding="utf-8") as file:
        return [(row["id"], row["path"], row["person"]) for row in csv.DictReader(file)]


def test_each_person_has_a_row_in_the_order_of_the_photos(batch, result):
    expected = [(name, f"/photos/{name}.jpg", person) for name in ("one", "two") for person in "01"]
    assert people_of(batch) == expected
    again = replace(result, people=result.people[:1])
    process = PhotoProcessor(
        BatchJob(load_config(preset="mock"), str(batch), "none"), lambda *_: again
    )
    with Journal(batch / "journal.jsonl") as journal:
        for name in ("one", "=3"):
            journal.append(process(PhotoItem(name, f"/photos/{name}.jpg")))
    assert people_of(batch) == [*expected[2:], expected[0], ("'=3", "/photos/=3.jpg", "0")]
    with write_tables(batch)[0].open(newline="") as file:
        assert not {"people_rows"} & set(next(csv.reader(file)))


def test_no_text_of_the_csv_table_is_a_formula(tmp_path):
    job = BatchJob(load_config(preset="mock"), str(tmp_path), "none", with_thumbnails=False)
    with Journal(tmp_path / "journal.jsonl") as journal:
        for name in ("=cmd|'calc'!A0", "plain"):
            journal.append(
                failed_row(job, PhotoItem(name, f"/photos/{name}"), "InputError", "=1+1", 0.0)
            )
    with write_tables(tmp_path)[0].open(newline="", encoding="utf-8") as file:
        rows = [(row["id"], row["message"]) for row in csv.DictReader(file)]
    assert rows == [("'=cmd|'calc'!A0", "'=1+1"), ("plain", "'=1+1")]


def test_the_contact_sheet_is_one_file_that_needs_no_network(batch):
    page = write_contact_sheet(batch).read_text()
    assert not re.search(r"https?:|src=\"(?!data:)|@import|url\(", page)
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    cards = json.loads(data[1])
    assert [(card["name"], card["state"], card["people"]) for card in cards] == [
        ("one", "done", 2),
        ("two", "done", 2),
        ("bad", "failed", None),
    ]
    assert cards[0]["thumbnail"].startswith("/9j/")
    assert len(cards[0]["thumbnail"]) < 40_000
    assert [card["title"] for card in cards] == ["one.jpg", "two.jpg", "bad.jpg"]
    assert cards[2]["message"] == "cannot read the photo bad.jpg: </script><b>&"
    # a result of people alone has no page
    assert (cards[0]["link"], cards[0]["lacks_page"]) == ("", False)
