"""Photos that cannot be read or break a backend are rows with their reason, and the others have their results.

``broken_batch.py`` does the same with the command, and with workers that hang or die.
"""

from __future__ import annotations

from pathlib import Path

from broken_batch import broken_photos, faults_of, png
from faulty import FAULTS, RAISING, SETTINGS, mark, photo
from physic_core.batch.photos import find_photos
from physic_core.batch.process import BatchJob, PhotoProcessor
from physic_core.batch.run import plan_batch, run_batch
from physic_core.batch.saving import Saving
from physic_core.configuration.model import load_config

DEVIATING = ("metric_depth-", "body_estimator-")


def test_a_batch_of_broken_photos_has_a_row_for_each(tmp_path: Path) -> None:
    expected = {}
    (tmp_path / "photos").mkdir()
    refused = [next(name for name in FAULTS if name.startswith(kind) and FAULTS[name][1]) for kind in DEVIATING]
    contents = {name: png(mark(name)) for name in (*RAISING, *refused, "interferes")} | {"good": png(photo())}
    for number, (name, content) in enumerate(contents.items()):
        expected[f"{number}.png"] = FAULTS[name][1] if name in FAULTS else ""
        (tmp_path / "photos" / f"{number}.png").write_bytes(content)
    for number, write in enumerate(broken_photos(png(photo())).values()):
        expected[f"broken-{number}.png"] = "InputError"
        write(tmp_path / "photos" / f"broken-{number}.png")
    (tmp_path / "photos.csv").write_text("\n".join(["path", *(f"photos/{name}" for name in expected)]))
    (tmp_path / "out").mkdir()
    config = load_config(preset="mock", overrides=SETTINGS, environment={})
    job = BatchJob(config, str(tmp_path / "out"), Saving("numbers", thumbnails=False))
    items = find_photos([str(tmp_path / "photos.csv")])
    process = PhotoProcessor(job)
    run_batch(items, job, lambda todo, job: (process(item) for item in todo), tmp_path / "out" / "journal.jsonl")
    assert list(faults_of(tmp_path / "out", expected)) == []
    assert plan_batch(items, job).todo == ()
