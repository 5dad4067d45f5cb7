"""Moments in a batch: a group of photos is one result with all cameras, and photos of other people are graded bad."""

from __future__ import annotations

import json
from pathlib import Path

from PIL import Image

from physic_core import load_config, load_reconstruction
from physic_core.batch.journal import read_journals
from physic_core.batch.photos import list_photos
from physic_core.batch.process import BatchJob, PhotoProcessor
from physic_core.batch.run import plan_batch, run_batch
from physic_core.interfaces import INTERFACES
from physic_testing.worlds import build_world, view_names

QUIET = {name: {"options": {"noise": 0.25}} for name in INTERFACES}


def test_a_table_of_moments_gives_one_result_for_each(tmp_path: Path):
    worlds = {name: build_world(name, 4, (240, 180)) for name in (*view_names("hug", 2), "sit_on_floor")}
    files = ("a.png", "b.png", "other.png")
    for file, world in zip(files, worlds.values(), strict=True):
        Image.fromarray(world.image).save(tmp_path / file)
    (tmp_path / "table.csv").write_text("path,moment\na.png,hug\nb.png,hug\na.png,strangers\nother.png,strangers\n")
    config = load_config(preset="mock", flags={"noise": QUIET})
    job = BatchJob(config, str(tmp_path / "out"), "numbers", thumbnails=False)
    process = PhotoProcessor(job)

    def todo():
        return plan_batch(list_photos([str(tmp_path / "table.csv")]).photos, job).todo

    def run(items):
        run_batch(items, job, lambda items, job: (process(item) for item in items), tmp_path / "out" / "journal.jsonl")

    run(todo())
    rows = read_journals(tmp_path / "out").last
    assert {name: (row["state"], row["error"]) for name, row in rows.items()} == {
        "hug": ("done", ""),
        "strangers": ("done", ""),
    }
    assert rows["strangers"]["grade"] == "bad"
    folder = tmp_path / "out" / rows["hug"]["folder"]
    result = load_reconstruction(folder)
    assert sorted(camera.photo for camera in result.cameras) == ["a.png", "b.png"]
    moment = json.loads((folder / "moment.json").read_text())
    assert sorted(photo["index"] for photo in moment["photos"]) == [0, 1]
    assert todo() == ()

    written = (folder / "moment.json").read_bytes()
    for damaged in (None, written[:-1]):
        (folder / "moment.json").unlink() if damaged is None else (folder / "moment.json").write_bytes(damaged)
        assert [item.id for item in todo()] == ["hug"]
    run(todo())
    assert (folder / "moment.json").read_bytes() == written
    assert todo() == ()
