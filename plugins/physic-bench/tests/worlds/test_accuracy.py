"""Worlds through the mocks and the engine: what is kept, what fails, and the figures."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from physic_bench.bodies import BodyFiles
from physic_bench.readers import read_plain
from physic_bench.run import Method, evaluate_methods
from physic_bench.worlds.ablation import ablation_rows, select_rows
from physic_bench.worlds.frames import BenchmarkJob, solve_world, solve_worlds, world_frames
from physic_core.cli import main
from physic_core.configuration.model import load_config
from physic_core.errors import ConfigError
from physic_core.interfaces import INTERFACES
from physic_testing.worlds import load_world

WORLD = "stand"
NOISY = [f"{name}.options.noise=1" for name in INTERFACES]


def job(folder, *overrides, rows=("start", "full")):
    config = load_config(preset="mock", overrides=list(overrides))
    return BenchmarkJob(config, select_rows("default", rows), folder)


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
    picked = select_rows("paper", ["paper", "full", "start"])
    assert [row.key for row in picked] == ["start", "full", "paper"]
    with pytest.raises(ConfigError, match=r"^no row named 'ful'"):
        select_rows("default", ["ful"])
    with pytest.raises(ConfigError, match="no engine preset named 'best'"):
        ablation_rows("best")


def test_results_of_another_config_or_row_are_others(tmp_path):
    usual, noisy = (job(tmp_path, *more) for more in ((), NOISY))
    assert len({work.results(row) for work in (usual, noisy) for row in work.rows}) == 4


def test_a_world_is_solved_once(tmp_path, monkeypatch):
    work = job(tmp_path)
    assert solve_world(WORLD, work) == {}

    def never(*_):
        raise AssertionError("asked again")

    monkeypatch.setattr("physic_core.pipeline.estimate.run_backends", never)
    assert list(solve_worlds([WORLD], work)) == [(WORLD, {})]


def test_the_truth_is_perfect_and_touches_its_scene(tmp_path):
    """Two people who hug, in an order of its own."""
    world = load_world("hug")
    order = [1, 0]
    arrays = {name: getattr(world, name)[order] for name in ("vertices", "joints", "contact")}
    (frame,) = world_frames(["hug"]).frames
    names = np.array(frame.truth().people[0].joint_names)
    np.savez(tmp_path / "hug.npz", joint_names=names, K=world.intrinsics.matrix, **arrays)
    found = evaluate_methods(
        world_frames(["hug"]), [Method("true", "plain", tmp_path)], BodyFiles()
    )
    for record in found.records["true"]:
        assert record["found"]
        assert record["me_mpjpe"] == record["me_pve"] == 0
        assert record["focal_ratio"] == 1
        assert record["contact"]["annotated"]["hits"] > 0
        assert record["contact"]["annotated"]["false_alarms"] == 0
        assert record["floating_mm"] < 20
        assert record["penetration_mm"] < 20


def test_the_engine_is_better_than_a_start_with_errors(tmp_path):
    work = job(tmp_path, *NOISY)
    assert solve_world(WORLD, work) == {}
    (frame,) = world_frames([WORLD]).frames
    methods = [Method(row.key, "plain", work.results(row)) for row in work.rows]
    found = evaluate_methods(world_frames([WORLD]), methods, BodyFiles()).records
    assert found["full"][0]["me_mpjpe"] < found["start"][0]["me_mpjpe"]
    assert read_plain(work.results(work.rows[0]), frame).floor is None


@pytest.mark.parametrize(
    ("broken", "failed"),
    [("optimise.run_engine", {"full"}), ("estimate.run_backends", {"start", "full"})],
)
def test_what_fails_is_counted(broken, failed, tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError("no memory")

    monkeypatch.setattr(f"physic_core.pipeline.{broken}", fail)
    assert solve_world(WORLD, job(tmp_path)) == dict.fromkeys(failed, "RuntimeError: no memory")


# ---- the command
# --------------------------------------------------------------------------------------------------


def bench(*arguments):
    return CliRunner().invoke(main, ["bench", "accuracy", *arguments])


def test_a_trial_stands_beside_the_full_row(tmp_path):
    finished = bench(
        "--world", WORLD, "-o", str(tmp_path / "out"), "--set", "joint.optimiser.steps=0"
    )
    assert finished.exit_code == 0, finished.output
    assert "Difference from full" in finished.output
    document = json.loads(
        (tmp_path / "out" / "results.json").read_text(),
        parse_constant=lambda text: pytest.fail(f"{text} is not JSON"),
    )
    assert list(document["differences"]) == ["trial"]
    rows = document["settings"]["rows"]
    assert rows["trial"]["label"] == "full, joint.optimiser.steps=0"
    assert rows["trial"]["engine"]["joint"]["optimiser"]["steps"] == 0
    assert document["records"]["trial"][0]["me_mpjpe"] > 0
    assert "| PA-MPJPE, mm |" in (tmp_path / "out" / "table.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "joint.optimiser.stepz=0"], "stepz"),
        (["--set", "engine.preset=paper"], "say it with --preset NAME"),
        (["--preset", "best"], "no engine preset named 'best'"),
        (["--rows", "fll"], "no row named 'fll'"),
        (["--world", "moon"], "no world named 'moon'"),
        (["--set", "metric_depth.options.fog=1"], "fog"),
    ],
)
def test_invalid_options_are_reported_before_anything_runs(arguments, message, tmp_path):
    finished = bench("-o", str(tmp_path / "out"), *arguments)
    assert finished.exit_code == 2
    assert message in finished.output
    assert "Traceback" not in finished.output


@pytest.mark.parametrize("name", ["results.json", "table.txt"])
def test_a_file_of_the_user_is_not_replaced(name, tmp_path):
    (tmp_path / name).write_text("mine")
    finished = bench("-o", str(tmp_path))
    assert (finished.exit_code, (tmp_path / name).read_text()) == (2, "mine")
