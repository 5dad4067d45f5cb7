"""Pictures and pages show what the code at hand gives, and say where the photos are from."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PHOTOS = sorted(path for path in (ROOT / "examples").iterdir() if path.suffix in (".jpg", ".png"))
NOTEBOOK = ROOT / "docs" / "notebooks" / "first-photo.ipynb"


@pytest.fixture(scope="module")
def numbers() -> Iterator[ModuleType]:
    """``tools/docs_numbers.py``."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        import docs_numbers

        yield docs_numbers


@pytest.fixture(scope="module")
def first_photo() -> tuple[Any, str, str]:
    """Return what the first notebook makes of the demo photo, what it printed when it was kept, and what it prints."""
    cells = [cell for cell in json.loads(NOTEBOOK.read_text("utf-8"))["cells"] if cell["cell_type"] == "code"]
    outputs = [output for cell in cells for output in cell["outputs"] if output["output_type"] == "stream"]
    names: dict[str, Any] = {}
    with contextlib.chdir(NOTEBOOK.parent), contextlib.redirect_stdout(io.StringIO()) as printed:
        for cell in cells:
            exec("".join(cell["source"]), names)
    return names["result"], "".join("".join(output["text"]) for output in outputs), printed.getvalue()


def test_pictures_of_the_demo_show_the_numbers_of_today(first_photo: tuple[Any, str, str], numbers: ModuleType):
    found = numbers.differences(numbers.read_numbers()["couple"], numbers.numbers_of(first_photo[0]))
    assert not found, f"`{numbers.COMMAND}` renews the pictures"


def test_the_first_notebook_prints_what_it_shows(first_photo: tuple[Any, str, str], numbers: ModuleType):
    assert not numbers.text_differences(*first_photo[1:]), f"`{numbers.COMMAND}` renews the notebook"


def test_pages_state_the_numbers_beside_the_pictures(numbers: ModuleType):
    shown = {page: numbers.marked_lines(page.read_text("utf-8")) for page in numbers.pages_with_marks()}
    assert {ROOT / "README.md", ROOT / "docs" / "gallery.md"} <= {*shown}
    lines = numbers.lines()
    wrong = {
        f"{page.name}: {name}": line
        for page, marked in shown.items()
        for name, line in marked.items()
        if line != lines[name]
    }
    assert not wrong, f"`{numbers.COMMAND}` renews the lines"


def test_the_gallery_shows_six_photos_and_two_of_them_failed(numbers: ModuleType):
    shown = numbers.marked_lines((ROOT / "docs" / "gallery.md").read_text("utf-8"))
    grades = Counter(
        one["grade"] for name, one in numbers.read_numbers().items() if name in shown and "examples" in one["of"]
    )
    assert grades.total() == 6
    assert grades["good"] == 4


def test_every_picture_of_a_result_has_its_numbers(numbers: ModuleType):
    drawn = Counter(picture for content in numbers.read_numbers().values() for picture in content["pictures"])
    there = {path.name for path in (ROOT / "docs" / "pictures").glob("*.*") if not path.name.startswith("export-")}
    assert drawn == Counter(there)


@pytest.mark.parametrize("photo", PHOTOS, ids=lambda path: path.name)
def test_the_source_of_an_example_photo_stands_beside_it(photo: Path):
    (row,) = re.findall(
        rf"^\| `{photo.name}` \|.*\|$",
        (ROOT / "examples" / "README.md").read_text("utf-8").partition("## Where")[2],
        re.M,
    )
    assert f"`{hashlib.sha256(photo.read_bytes()).hexdigest()}`" in row
    assert re.search(r"Apache-2\.0|MIT", row)


def test_the_demo_of_make_is_the_photo_of_the_readme():
    (photo,) = re.findall(r"^PHOTO \?= (\S+)$", (ROOT / "Makefile").read_text("utf-8"), re.M)
    assert f"reconstructs {photo}" in (ROOT / "README.md").read_text("utf-8")


def result(**changes: Any) -> dict[str, Any]:
    person = {"grade": "good", "failed_checks": [], "distance_m": 3.6, "contact_percent": 16.5}
    return {"grade": "good", "failed_checks": [], "focal_px": 1088, "people": [person], **changes}


def test_numbers_that_differ_are_named(numbers: ModuleType):
    cut = {"grade": "doubtful", "failed_checks": ["Visible legs"], "distance_m": 3.0, "contact_percent": 9.0}
    assert numbers.differences(result(), result(focal_px=1090)) == []
    assert numbers.differences(result(), result(grade="doubtful", focal_px=980, people=[cut, cut])) == [
        "grade: good is shown, doubtful is measured",
        "focal length, px: 1088 is shown, 980 is measured",
        "number of people: 1 is shown, 2 is measured",
        "grade of person 0: good is shown, doubtful is measured",
        "failed_checks of person 0: [] is shown, ['Visible legs'] is measured",
        "distance of person 0, m: 3.6 is shown, 3.0 is measured",
        "contact of person 0, % of the vertices: 16.5 is shown, 9.0 is measured",
    ]


def test_a_caption_names_grades_and_failed_checks(numbers: ModuleType):
    cut = {"grade": "doubtful", "failed_checks": ["Visible legs", "Lean"], "distance_m": None, "contact_percent": 9.0}
    assert numbers.caption(result(grade="doubtful", failed_checks=["Floor"], people=[cut])) == (
        "Grade: **doubtful**; failed: Floor. Focal length 1088 px. "
        "Person 0: doubtful, without a body, 9.0 % in contact; failed: Visible legs, Lean."
    )


def test_printed_numbers_may_differ_by_rounding_and_words_may_not(numbers: ModuleType):
    shown = "person 0: 2198 vertices touch, good\nscale 8 %\n"
    assert numbers.text_differences(shown, "person 0: 2206 vertices touch, good\nscale 8 %\n") == []
    assert numbers.text_differences(shown, "person 0: 2198 vertices touch, bad\nscale 12 %\n") == [
        "'person 0: 2198 vertices touch, good' is shown, 'person 0: 2198 vertices touch, bad' is printed",
        "'scale 8 %' is shown, 'scale 12 %' is printed",
    ]
    assert numbers.text_differences(shown, "nothing\n") == ["2 lines are shown, 1 are printed"]
