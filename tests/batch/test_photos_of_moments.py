"""Photos of one moment in a batch: one row, done anew when one of them changes, joined by a plugin."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from fuzzing.tiny_result import tiny_result
from physic_core import load_reconstruction
from physic_core.batch.journal import read_journals
from physic_core.batch.photos import list_photos
from physic_core.batch.process import BatchJob, PhotoProcessor
from physic_core.batch.run import plan_batch, run_batch
from physic_core.cli import main
from physic_core.configuration.model import load_config
from physic_core.errors import InputError, NoPersonError

JOIN = """
from dataclasses import replace
from physic_core.errors import InputError
from physic_core.types import CameraView

def join(photos, config):
    names = [f"{photo.name} {photo.settings.get('stature')} {photo.result is not None}" for photo in photos]
    if len(photos) > 2:
        raise InputError(f"too many: {', '.join(names)}")
    if photos[0].name == "odd.jpg":
        return None
    result = photos[0].result
    return replace(result, notes=tuple(names), cameras=(result.reference_view(photos[0].name),))
"""


@pytest.fixture
def joined(site: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    site.install("physic-first", JOIN, entry="first = physic_first:join", group="physic.moments")
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-first,physic-mock")


@pytest.fixture
def table(tmp_path: Path) -> Path:
    names = ("a", "b", "alone", "odd", "c", "d", "e", "nobody", "f")
    for name in names:
        (tmp_path / f"{name}.jpg").write_text(name)
    moments = ("pair", "pair", "", "odd", "odd", "three", "three", "three", "half")
    rows = [f"{name}.jpg,{moment}" for name, moment in zip(names, moments, strict=True)]
    (tmp_path / "table.csv").write_text("\n".join(["path,moment", *rows, "nobody.jpg,half"]))
    return tmp_path / "table.csv"


def reconstruct(path: str, settings: Mapping[str, Any]) -> Any:
    if Path(path).stem == "nobody":
        raise NoPersonError("no person was found")
    return tiny_result()


def run(table: Path, out: Path) -> list[str]:
    """Run or resume a batch in this process; return the ids that were done."""
    job = BatchJob(load_config(preset="mock"), str(out), "numbers", thumbnails=False)
    todo, process = plan_batch(list_photos([str(table)]).photos, job).todo, PhotoProcessor(job, reconstruct)
    run_batch(todo, job, lambda items, job: (process(item) for item in items), out / "journal.jsonl")
    return [item.id for item in todo]


@pytest.mark.usefixtures("joined")
def test_a_moment_is_one_row_and_a_bad_one_ends_nothing(table: Path, tmp_path: Path):
    run(table, tmp_path / "out")
    rows = read_journals(tmp_path / "out").last
    assert {name.partition("-")[0]: row["state"] for name, row in rows.items()} == {
        "alone": "done",
        "pair": "done",
        "odd": "failed",
        "three": "failed",
        "half": "done",
    }
    assert rows["three"]["error"] == "InputError"
    assert rows["three"]["message"] == "too many: d.jpg None True, e.jpg None True, nobody.jpg None False"
    assert rows["odd"]["message"] == "the moment 'first' of physic-first 1.0 should be a Reconstruction, got NoneType"
    assert rows["pair"]["path"] == str(tmp_path / "a.jpg")
    assert load_reconstruction(tmp_path / "out" / rows["pair"]["folder"]).notes == (
        "a.jpg None True",
        "b.jpg None True",
    )
    assert load_reconstruction(tmp_path / "out" / rows["half"]["folder"]).cameras[0].photo == "f.jpg"


@pytest.mark.usefixtures("joined")
def test_a_moment_is_done_anew_if_one_of_its_photos_changes(table: Path, tmp_path: Path):
    out = tmp_path / "out"
    assert len(run(table, out)) == 5
    assert run(table, out) == []
    os.utime(tmp_path / "b.jpg", ns=(1, 1))
    assert run(table, out) == ["pair"]
    assert run(table, out) == []
    table.write_text(table.read_text().replace("a.jpg,pair\nb.jpg,pair", "b.jpg,pair\na.jpg,pair"))
    assert run(table, out) == ["pair"]


@pytest.mark.usefixtures("joined")
def test_a_dry_run_names_all_photos_of_a_moment(table: Path, tmp_path: Path):
    table.write_text("path,moment\na.jpg,pair\nb.jpg,pair\n")
    done = CliRunner().invoke(
        main, ["batch", str(table), "-o", str(tmp_path / "out"), "--preset", "mock", "--table", "csv", "--dry-run"]
    )
    assert done.stdout == f"{tmp_path / 'a.jpg'}\n{tmp_path / 'b.jpg'}\n"


def test_without_a_plugin_moments_name_the_distribution(table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PHYSIC_PLUGINS", "physic-mock")
    done = CliRunner().invoke(
        main, ["batch", str(table), "-o", str(tmp_path / "out"), "--preset", "mock", "--table", "csv"]
    )
    assert (done.exit_code, done.stdout) == (4, "")
    assert done.stderr == (
        "Error: photos of one moment are joined by physic-scene, which is not installed, or hidden by "
        "PHYSIC_PLUGINS='physic-mock': `pip install -e plugins/physic-scene` in a checkout of PhySIC\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_moment_has_several_photos(tmp_path: Path):
    (tmp_path / "table.csv").write_text("path,moment\na.jpg,pair\n")
    with pytest.raises(InputError) as error:
        list_photos([str(tmp_path / "table.csv")])
    assert str(error.value) == (
        f"{tmp_path / 'table.csv'}: only {tmp_path / 'a.jpg'} is of the moment 'pair': name another photo of it, or "
        "leave the cell empty"
    )
