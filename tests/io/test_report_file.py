"""report.html in the folder of a result, pages of broken results, and the sheet of a folder of
results.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from physic_core.errors import InputError
from physic_core.io.report_file import add_report
from physic_core.io.results import load_reconstruction, read_record, save_reconstruction


@pytest.fixture(scope="module")
def result(make):
    return replace(make(), photo="sha256:1")


@pytest.fixture(scope="module")
def saved(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved") / "my photo-physic"
    save_reconstruction(result, folder, "numbers")
    return folder


@pytest.fixture
def folder(saved, tmp_path):
    return Path(shutil.copytree(saved, tmp_path / saved.name))


def test_the_page_is_a_file_of_the_result(folder, result):
    path = add_report(folder)
    assert path == folder / "report.html"
    assert "<h1>my photo-physic</h1>" in path.read_text(encoding="utf-8")
    document = json.loads((folder / "reconstruction.json").read_text())
    assert document["files"]["report.html"].startswith("sha256:")
    load_reconstruction(folder)
    add_report(folder, "photo.jpg")
    assert "<h1>photo.jpg</h1>" in path.read_text(encoding="utf-8")
    # The next run of this photo replaces the result, and removes the page of the earlier one.
    save_reconstruction(replace(result, photo_name="beach.jpg"), folder, "numbers")
    assert not path.exists()
    assert "<h1>beach.jpg</h1>" in add_report(folder).read_text(encoding="utf-8")


def test_a_result_is_saved_with_its_page_or_without_one_that_fails(folder, result, monkeypatch):
    save_reconstruction(result, folder, "numbers", page="photo.jpg")
    assert "<h1>photo.jpg</h1>" in (folder / "report.html").read_text(encoding="utf-8")
    assert "report.html" in read_record(folder).files

    def fail(result, title):
        raise MemoryError

    monkeypatch.setattr("physic_visual.pictures.report_html", fail)
    save_reconstruction(result, folder, "numbers", page="photo.jpg")
    assert not (folder / "report.html").exists()
    assert "pictures failed: MemoryError" in load_reconstruction(folder).warnings[-1]


def test_the_page_of_a_damaged_result_says_what_is_wrong(folder):
    arrays = folder / "reconstruction.npz"
    arrays.write_bytes(arrays.read_bytes()[:5000])
    with pytest.raises(InputError, match="run the reconstruction again"):
        add_report(folder)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "This result cannot be shown" in page
    assert "run the reconstruction again" in page


def test_the_command_writes_pages_and_goes_on_after_a_broken_result(folder, tmp_path, physic):
    (tmp_path / "nothing").mkdir()
    done = physic("report", tmp_path / "nothing", folder)
    assert (done.exit_code, list((tmp_path / "nothing").iterdir())) == (3, [])
    assert f"wrote {folder / 'report.html'}\n" in done.output
    assert f"Error: no result in {tmp_path / 'nothing'}" in done.output
    done = physic("report", folder, "-o", tmp_path / "x.html", "--title", "one <b>")
    assert done.output == f"wrote {tmp_path / 'x.html'}\n"
    assert "<h1>one &lt;b&gt;</h1>" in (tmp_path / "x.html").read_text(encoding="utf-8")
    done = physic("report", folder, folder, "-o", tmp_path / "x.html")
    assert done.exit_code == 2
    assert done.output.endswith("Error: --out needs one result, got 2\n")


def test_a_folder_of_results_gets_a_sheet_that_links_to_their_pages(folder, tmp_path, physic):
    (tmp_path / "broken").mkdir()
    start = (folder / "reconstruction.json").read_bytes()[:200]
    (tmp_path / "broken" / "reconstruction.json").write_bytes(start)
    (tmp_path / "cut").mkdir()
    shutil.copy(folder / "reconstruction.json", tmp_path / "cut")
    (tmp_path / "cut" / "reconstruction.npz").write_bytes(b"PK")
    done = physic("report", tmp_path)
    assert done.output == f"wrote {tmp_path / 'contact-sheet.html'}\n"
    broken, cut, good = cards(tmp_path)
    assert cut["state"] == "failed"
    assert "reconstruction.npz" in cut["message"]
    assert (good["name"], good["link"], good["state"]) == ("my photo-physic", "", "done")
    assert (good["people"], good["usable"]["place"], good["error"]) == (2, 0, "")
    assert len(good["thumbnail"]) > 500
    assert (broken["state"], broken["error"]) == ("failed", "InputError")
    assert "reconstruction.json" in broken["message"]
    sheet = tmp_path / "contact-sheet.html"
    assert "physic report . --each" in sheet.read_text(encoding="utf-8")

    done = physic("report", "--each", tmp_path)
    assert done.exit_code == 0
    assert "physic report . --each" not in sheet.read_text(encoding="utf-8")
    broken, _, good = cards(tmp_path)
    assert (good["link"], broken["link"]) == ("my photo-physic/report.html", "broken/report.html")
    assert "reconstruction.json" in (tmp_path / "broken" / "report.html").read_text(
        encoding="utf-8"
    )


def test_a_contact_sheet_of_the_user_ends_the_command_before_the_first_page(
    folder, tmp_path, physic
):
    (tmp_path / "contact-sheet.html").write_text("mine")
    done = physic("report", "--each", tmp_path)
    assert (done.exit_code, (tmp_path / "contact-sheet.html").read_text()) == (2, "mine")
    assert not (folder / "report.html").exists()


def cards(folder):
    page = (folder / "contact-sheet.html").read_text(encoding="utf-8")
    return json.loads(page.split('id="data" type="application/json">')[1].split("</script>")[0])
