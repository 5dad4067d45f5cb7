"""Worlds through the mocks and the engine: what is kept, what fails, what a run that is stopped
leaves behind.
"""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from physic_bench.tables import write_results
from physic_bench.worlds import run_worlds, world_evidence
from physic_bench.worlds.ablation import ablation_rows, select_rows
from physic_bench.worlds.results import document_of, notes_of, tables_of
from physic_bench.worlds.run_worlds import BenchmarkJob, run_world
from physic_bench.worlds.world_evidence import estimate_evidence, load_evidence
from physic_core.body import load_body
from physic_core.cli import main
from physic_core.configuration.model import load_config
from physic_core.configuration.resolve import resolve
from physic_core.errors import ConfigError, PhysicError
from physic_core.files.plain import write_value
from physic_core.interfaces import INTERFACES
from physic_testing.worlds import load_world

WORLD = "stand"


@pytest.fixture(scope="module")
def config():
    return load_config(preset="mock")


@pytest.fixture(scope="module")
def evidence(config):
    plan = resolve(config)
    return estimate_evidence(load_world(WORLD), plan, load_body("embedded"), None)


def alike(one, other):
    if is_dataclass(one):
        return type(one) is type(other) and all(
            alike(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)
        )
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(
            one, other, equal_nan=one.dtype.kind == "f"
        )
    if isinstance(one, torch.Tensor):
        return (
            isinstance(other, torch.Tensor) and one.dtype == other.dtype and torch.equal(one, other)
        )
    return one == other


def test_evidence_is_read_as_it_was_written(evidence, tmp_path):
    write_value(tmp_path / "a" / "e.npz", evidence)
    assert alike(load_evidence(tmp_path / "a" / "e.npz"), evidence)
    (tmp_path / "a" / "e.npz").write_bytes((tmp_path / "a" / "e.npz").read_bytes()[:-900])
    assert load_evidence(tmp_path / "a" / "e.npz") is None
    assert load_evidence(tmp_path / "none.npz") is None
    np.savez(tmp_path / "other.npz", layout=np.array("3"))
    assert load_evidence(tmp_path / "other.npz") is None


def test_the_name_of_an_evidence_file_depends_on_all_that_changes_it(config):
    noisy = load_config(preset="mock", overrides=["metric_depth.options.noise_seed=1"])
    keys = [
        world_evidence.evidence_key(world, resolve(found))
        for world, found in ((WORLD, config), ("lie", config), (WORLD, noisy))
    ]
    assert len(set(keys)) == len(keys)
    trial = load_config(preset="mock", overrides=["engine.joint.optimiser.steps=3"])
    assert world_evidence.evidence_key(WORLD, resolve(trial)) == keys[0]


def test_rows_are_the_papers_and_can_be_picked():
    rows = ablation_rows("default")
    assert [row.key for row in rows] == [
        "start", "reprojection", "contact", "penetration", "depth", "occlusion", "full", "prox",
        "static",
    ]  # fmt: skip
    assert rows[0].settings is None
    assert rows[6].settings == load_config(preset="mock").engine.settings()
    assert len({row.digest for row in rows}) == len(rows)
    assert select_rows("default", []) == rows
    assert [row.key for row in select_rows("paper", ["paper", "full", "start"])] == [
        "start",
        "full",
        "paper",
    ]
    with pytest.raises(ConfigError, match=r"^no row named 'ful'"):
        select_rows("default", ["ful"])
    with pytest.raises(ConfigError, match="no engine preset named 'best'"):
        ablation_rows("best")


def test_a_world_is_looked_at_once_and_its_rows_are_kept(config, tmp_path, monkeypatch):
    work = BenchmarkJob(config, select_rows("default", ["start", "full"]), tmp_path)
    first = run_world(WORLD, work)
    assert first["error"] == ""
    assert list(first["rows"]) == ["start", "full"]
    for row in first["rows"].values():
        assert [person["found"] for person in row["people"]] == [True]

    def never(*_):
        raise AssertionError("asked again")

    monkeypatch.setattr(world_evidence, "run_backends", never)
    monkeypatch.setattr("physic_core.pipeline.optimise.run_engine", never)
    again = run_world(WORLD, work)
    assert again == first
    assert json.loads(json.dumps(first)) == first


def test_the_engine_is_better_than_a_start_with_errors():
    noisy = load_config(preset="mock", overrides=[f"{name}.options.noise=1" for name in INTERFACES])
    record = run_world(WORLD, BenchmarkJob(noisy, select_rows("default", ["start", "full"]), None))
    start, full = (record["rows"][key]["people"][0] for key in ("start", "full"))
    assert full["mpjpe_mm"] < start["mpjpe_mm"]
    assert "floating_mm" not in start
    assert record["rows"]["start"]["scene"] == {}


def test_what_fails_is_counted(config, monkeypatch):
    def broken(*_):
        raise RuntimeError("no memory\nleft")

    work = BenchmarkJob(config, select_rows("default", ["start", "full"]), None)
    with monkeypatch.context() as patch:
        patch.setattr("physic_core.pipeline.optimise.run_engine", broken)
        record = run_world(WORLD, work)
    assert record["rows"]["full"]["error"] == "RuntimeError: no memory\nleft"
    assert [p["found"] for p in record["rows"]["full"]["people"]] == [False]
    assert [p["found"] for p in record["rows"]["start"]["people"]] == [True]

    monkeypatch.setattr(world_evidence, "run_backends", broken)
    blind = run_world(WORLD, work)
    assert blind["error"] == "RuntimeError: no memory\nleft"
    assert [p["why"] for row in blind["rows"].values() for p in row["people"]] == [
        blind["error"]
    ] * 2
    notes = " ".join(notes_of([blind], work))
    assert "RuntimeError: no memory" in notes
    assert "1 people; missed: 1" in notes


def test_results_hold_everything_and_are_plain_json(config, tmp_path):
    work = BenchmarkJob(config, select_rows("default", ["start"]), None)
    records = [run_world(WORLD, work)]
    paths = write_results(
        tables_of(records, work), tmp_path, "two", [], document_of(records, 2, work, {})
    )
    assert [path.name for path in paths] == ["table.txt", "table.md", "results.json"]
    document = json.loads(
        paths[-1].read_text(), parse_constant=lambda text: pytest.fail(f"{text} is not JSON")
    )
    assert (document["complete"], document["worlds_done"], document["worlds_asked"]) == (
        False,
        1,
        2,
    )
    assert {"physic-core", "physic-mock", "torch"} <= set(document["versions"])
    assert document["worlds"][0]["rows"]["start"]["people"][0]["mpjpe_mm"] > 0
    assert document["settings"]["rows"]["start"] == {
        "label": "start (the estimators' own)",
        "engine": None,
    }
    assert paths[0].read_text().startswith("two\n")
    assert "| PA-MPJPE, mm |" in paths[1].read_text()


# ---- the command
# --------------------------------------------------------------------------------------------------


def bench(*arguments):
    return CliRunner().invoke(main, ["bench", *arguments])


def test_a_trial_stands_beside_the_full_row(tmp_path):
    world = ("--world", WORLD, "--cache", str(tmp_path / "cache"))
    finished = bench(
        "accuracy", *world, "-o", str(tmp_path / "out"), "--set", "joint.optimiser.steps=0"
    )
    assert finished.exit_code == 0, finished.output
    assert "Difference from full" in finished.output
    document = json.loads((tmp_path / "out" / "results.json").read_text())
    assert list(document["differences"]) == ["trial", "truth"]
    assert document["settings"]["rows"]["trial"]["label"] == "full, joint.optimiser.steps=0"
    assert document["settings"]["rows"]["trial"]["engine"]["joint"]["optimiser"]["steps"] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "joint.optimiser.stepz=0"], "stepz"),
        (["--set", "engine.preset=paper"], "say it with --preset NAME"),
        (["--preset", "best"], "no engine preset named 'best'"),
        (["--rows", "fll"], "no row named 'fll'"),
        (["--world", "moon"], "no world named 'moon'"),
        (["--cache", "x", "--no-cache"], "exclude each other"),
        (["--set", "metric_depth.options.fog=1"], "fog"),
    ],
)
def test_invalid_options_are_reported_before_anything_runs(arguments, message, tmp_path):
    finished = bench("accuracy", "-o", str(tmp_path / "out"), *arguments)
    assert finished.exit_code == 2
    assert message in finished.output
    assert "Traceback" not in finished.output


@pytest.mark.parametrize("name", ["results.json", "table.txt"])
def test_a_file_of_the_user_is_not_replaced(name, tmp_path):
    (tmp_path / name).write_text("mine")
    finished = bench("accuracy", "-o", str(tmp_path))
    assert (finished.exit_code, (tmp_path / name).read_text()) == (2, "mine")


@pytest.mark.parametrize(
    ("cause", "code"), [(KeyboardInterrupt(), 130), (PhysicError("a process was ended"), 1)]
)
def test_a_run_that_is_stopped_leaves_what_is_done(cause, code, tmp_path, monkeypatch):
    def stopped(worlds, work, jobs):
        yield run_world(worlds[0], work)
        raise cause

    monkeypatch.setattr(run_worlds, "run_cases", stopped)
    worlds = ("--world", WORLD, "--world", "lie", "--world", "walk")
    finished = bench("accuracy", *worlds, "--rows", "start", "--no-cache", "-o", str(tmp_path))
    assert finished.exit_code == code
    assert "1 of 3 worlds" in finished.output
    document = json.loads((tmp_path / "results.json").read_text())
    assert (document["complete"], document["worlds_done"]) == (False, 1)
