"""What a worker reserves, and the messages about it; Ray need not be installed."""

from __future__ import annotations

import json

import pytest

from physic_batch.photo_processor import BatchJob
from physic_batch.run import ExecutorSettings
from physic_core.configuration.model import load_config
from physic_core.errors import ConfigError
from physic_ray.executor import ray_executor
from physic_ray.resources import Resources
from physic_ray.worker import JsonActor, WorkerPlan, decode_item, encode_item


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gpu": "1"}, "no setting 'gpu'"),
        ({"gpus": "one"}, "got 'one'"),
        ({"cpus": "-1"}, r"got -1\.0"),
        ({"cpus": "0"}, "above 0"),
    ],
)
def test_invalid_options_are_refused_before_anything_starts(options, message):
    with pytest.raises(ConfigError, match=message):
        ray_executor(ExecutorSettings(options=options))


def test_workers_that_fit_on_the_nodes():
    nodes = [
        {"Alive": True, "Resources": {"CPU": 16.0, "memory": 20e9}},
        {"Alive": True, "Resources": {"CPU": 4.0, "memory": 90e9, "GPU": 1.0}},
        {"Alive": False, "Resources": {"CPU": 64.0, "memory": 200e9}},
    ]
    assert Resources().for_device("cpu").count_slots(nodes) == 13 + 4
    assert Resources(0.5, 0.25, 0.0).count_slots(nodes) == 4
    assert Resources(memory_gb=500.0).count_slots(nodes) == 0


def test_a_node_without_the_output_folder_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr("physic_ray.worker.VISIBLE_S", 0.0)
    job = BatchJob(load_config(preset="mock"), str(tmp_path), "none", with_thumbnails=False)
    actor = JsonActor(WorkerPlan(job, shared_file=str(tmp_path / "journal.jsonl")))
    monkeypatch.setattr("physic_ray.worker._node", lambda: "10.0.0.7")
    row = json.loads(actor({"item": '["a", "/a.jpg", {}]'})["row"])
    assert (row["refused"], row["node"]) == ("OutputError", "10.0.0.7")
    assert "journal.jsonl" in row["message"]


def test_every_name_of_a_photo_reaches_the_worker():
    from physic_batch.photos import PhotoItem

    item = PhotoItem(
        "\udcff ü \U0001f600", "/photos/\udcff.jpg", {"focal_px": 900.5, "stature": [1.7, 1.8]}
    )
    text = encode_item(item)
    assert text.isascii()
    assert decode_item(text) == item
