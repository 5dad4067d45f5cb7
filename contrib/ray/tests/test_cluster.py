"""A batch on a Ray cluster of two nodes on this machine: the rows of the local executor, whatever
fails.
"""

from __future__ import annotations

import os
import re
import sys
from collections import Counter
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest

from physic_batch.journal import COLUMNS, read_journals
from physic_batch.photo_processor import BatchJob
from physic_batch.photos import list_photos
from physic_batch.run import ExecutorSettings, plan_batch, run_batch, run_locally
from physic_batch.workers import WorkerSettings
from physic_core.configuration.model import load_config
from physic_core.errors import BackendError, ConfigError, OutputError
from physic_ray.cluster import connected
from physic_ray.executor import run_on_ray
from physic_ray.resources import Resources

# Ray is imported after the variables that it reads. It leaves sockets and files to the end of the
# process.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.skipif(find_spec("ray") is None, reason="needs Ray: pip install 'ray[data]'"),
]

STANDIN = Path(__file__).parents[3] / "plugins" / "batch" / "tests" / "batch" / "standin"
RESOURCES = Resources(memory_gb=0.0)
TIMES = ("seconds", "finished", "peak_mb")


@pytest.fixture(scope="module")
def cluster():
    """Two nodes that listen on 127.0.0.1, with 2 logical CPUs each."""
    paths = os.pathsep.join([str(STANDIN), os.environ.get("PYTHONPATH", "")])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
        patch.setenv("PYTHONPATH", paths)
        patch.syspath_prepend(STANDIN)
        from ray.cluster_utils import Cluster

        node = {"num_cpus": 2, "object_store_memory": 100_000_000, "include_dashboard": False}
        cluster = Cluster(initialize_head=True, head_node_args=node)
        try:
            cluster.second = cluster.add_node(
                **{k: v for k, v in node.items() if k != "include_dashboard"}
            )
            yield cluster
        finally:
            cluster.shutdown()


@pytest.fixture
def standin(monkeypatch):
    monkeypatch.syspath_prepend(STANDIN)
    import batch_standin
    import worker_standin

    batch_standin.refuse, batch_standin.crash = worker_standin.refuse, worker_standin.crash
    return batch_standin


def make_photos(folder, *names):
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / f"{name}.jpg").write_text(name)
    return folder


def job_for(out):
    return BatchJob(load_config(preset="mock"), str(out), "none", with_thumbnails=False)


def run(
    photos,
    job,
    executor,
    on_row=lambda row: None,
):
    todo = plan_batch(list_photos([str(photos)]).photos, job).todo
    run_batch(todo, job, executor, Path(job.out) / "journal.jsonl", on_row)


def on(cluster, open_worker, timeout=None):
    settings = ExecutorSettings(timeout=timeout, address=cluster.address)
    return partial(run_on_ray, settings=settings, resources=RESOURCES, open_worker=open_worker)


def comparable(out):
    return {
        i: {k: v for k, v in row.items() if k not in TIMES} for i, row in read_journals(out).items()
    }


def test_thirty_photos_have_the_rows_of_the_local_executor(cluster, standin, tmp_path):
    names = [f"photo {i} é" for i in range(25)] + ["abort", "broken", "hang", "nobody", "nobody 2"]
    photos = make_photos(tmp_path / "photos", *names)
    local = job_for(tmp_path / "local")
    remote = job_for(tmp_path / "remote")
    workers = WorkerSettings(1, timeout=5.0)
    run(
        photos,
        local,
        partial(run_locally, settings=workers, open_worker=partial(standin.open_processor, local)),
    )
    run(photos, remote, on(cluster, partial(standin.open_processor, remote), timeout=5.0))
    rows = comparable(tmp_path / "remote")
    assert rows == comparable(tmp_path / "local")
    assert len(rows) == 30
    assert Counter(row["error"] or row["state"] for row in rows.values()) == {
        "done": 25,
        "NoPersonError": 2,
        "Timeout": 1,
        "ValueError": 1,
        "WorkerDied": 1,
    }
    assert all(COLUMNS.keys() - set(TIMES) <= row.keys() for row in rows.values())
    assert plan_batch(list_photos([str(photos)]).photos, remote).todo == ()


def test_a_node_that_is_killed_costs_no_photo(cluster, standin, tmp_path):
    photos = make_photos(tmp_path / "photos", *(f"p{i}" for i in range(24)))
    job = job_for(tmp_path / "out")
    count = Counter[str]()

    def kill_one_node(row):
        count[row["state"]] += 1
        if count.total() == 6:
            cluster.remove_node(cluster.second, allow_graceful=False)

    run(photos, job, on(cluster, partial(standin.open_processor, job, 0.3)), kill_one_node)
    assert count == {"done": 24}
    lines = (tmp_path / "out" / "journal.jsonl").read_text().splitlines()
    assert len(lines) == len(read_journals(tmp_path / "out")) == 24
    cluster.second = cluster.add_node(num_cpus=2, object_store_memory=100_000_000)


@pytest.mark.parametrize(
    ("name", "photo", "kind", "message"),
    [
        ("refuse", "a", ConfigError, "preset mock: 1 error"),
        (
            "crash",
            "a",
            BackendError,
            "a worker ended while it loaded the backends: it was ended by SIGABRT",
        ),
        ("open_processor", "full", OutputError, "cannot write results: No space left on device"),
    ],
)
def test_what_concerns_every_photo_ends_the_batch_with_one_message(
    cluster,
    standin,
    tmp_path,
    name,
    photo,
    kind,
    message,
):
    photos = make_photos(tmp_path / "photos", photo)
    job = job_for(tmp_path / "out")
    with pytest.raises(kind) as error:
        run(photos, job, on(cluster, partial(getattr(standin, name), job)))
    assert re.sub(r" \(node [\d.]+\)$", "", str(error.value)) == message
    assert read_journals(tmp_path / "out") == {}


def test_a_dataset_becomes_parquet_files_and_its_checkpoint_leaves_out_what_is_written(
    cluster, tmp_path
):
    import pyarrow.dataset
    import ray
    import ray.data
    from PIL import Image

    import physic_ray
    from physic_ray.dataset import schema_of_rows
    from physic_testing.worlds import load_world

    Image.fromarray(load_world("stand", size=(96, 72)).image).save(tmp_path / "stand.png")
    table = tmp_path / "photos.csv"
    table.write_text(f"id,path\na,{tmp_path / 'stand.png'}\nb,{tmp_path / 'missing.jpg'}\n")

    def write():
        photos = ray.data.read_csv(str(table))
        rows = physic_ray.reconstruct(
            photos, "mock", resources=RESOURCES, checkpoint=str(tmp_path / "checkpoint")
        )
        rows.write_parquet(str(tmp_path / "rows"))
        files = pyarrow.dataset.dataset(str(tmp_path / "rows"))
        assert files.schema == schema_of_rows()
        return sorted(files.to_table().to_pylist(), key=lambda row: str(row["id"]))

    with connected(cluster.address):
        assert {node["NodeManagerAddress"] for node in ray.nodes()} == {"127.0.0.1"}
        ray.data.DataContext.get_current().enable_progress_bars = False
        first = write()
        assert [(row["id"], row["state"], row["error"]) for row in first] == [
            ("a", "done", ""),
            ("b", "failed", "InputError"),
        ]
        assert (first[0]["people"], first[1]["people"]) == (1.0, None)
        with table.open("a") as file:
            file.write(f"c,{tmp_path / 'missing.jpg'}\n")
        again = write()
        assert [row["id"] for row in again] == ["a", "b", "c"]
        assert again[:2] == first


def test_a_cluster_that_cannot_be_reached_is_one_message(tmp_path):
    settings = ExecutorSettings(address="127.0.0.1:1")
    photos = make_photos(tmp_path / "photos", "a")
    job = job_for(tmp_path / "out")
    with pytest.raises(ConfigError, match=r"127\.0\.0\.1:1"):
        run(photos, job, partial(run_on_ray, settings=settings, resources=RESOURCES))


def test_a_cluster_that_does_not_start_is_one_message(monkeypatch):
    def init(**_):
        raise Exception("The current node timed out during startup.")

    monkeypatch.setattr("ray.init", init)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    message = r"start Ray on this machine: .* timed out"
    with pytest.raises(ConfigError, match=message), connected(None):
        pass


def test_ray_is_imported_only_when_it_is_used():
    import subprocess

    code = "import sys, physic_ray, physic_ray.executor; print('ray' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
