"""What ``physic bench speed`` measures: its structure, its problems and its errors; never how long anything took."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_bench.worlds.speed import measure_speed
from physic_bench.worlds.speed_nearest import nearest_errors_mm
from physic_bench.worlds.synthetic_problems import make_joint_problem
from physic_core import engine_preset
from physic_core.body import load_body
from physic_core.engine.joint.solve import optimize
from physic_core.engine.settings import with_overrides
from physic_core.errors import ConfigError
from physic_core.geometry.neighbors import NearestPointSearch

SMALL = (160, 120)


@pytest.fixture(scope="module")
def body():
    return load_body("embedded")


@pytest.mark.parametrize("people", [1, 2, 4, 8])
def test_everybody_is_in_the_picture_and_starts_beside_the_truth(body, people):
    problem = make_joint_problem(body, people, SMALL)
    problem.check()
    assert len(problem) == people
    assert (problem.masks.flatten(1).sum(1) > 20).all()
    assert (problem.masks.sum(0) <= 1).all()
    x, y = problem.keypoints.unbind(-1)
    assert ((x > -10) & (x < SMALL[0] + 10) & (y > -20) & (y < SMALL[1] + 20)).all()


def test_stage_three_makes_the_problem_better(body):
    problem = make_joint_problem(body, 2, SMALL)
    result = optimize(problem, with_overrides(engine_preset("default").joint, {"optimiser": {"steps": 20}}))
    start, end = (sum(pair[k] for pair in result.losses.values()) for k in (0, 1))
    assert end < 0.5 * start
    assert result.failures == ("", "")


def test_the_same_problem_is_solved_the_same_bit_for_bit(body):
    settings = with_overrides(engine_preset("default").joint, {"optimiser": {"steps": 25}})
    first, second = (optimize(make_joint_problem(body, 2, SMALL), settings) for _ in range(2))
    for name in ("rotations", "betas", "transl", "vertices", "joints", "depth_inside", "surface_share"):
        assert torch.equal(getattr(first, name), getattr(second, name)), name
    assert first.scene_scale == second.scene_scale
    assert first.losses == second.losses


def test_errors_are_distances_beyond_the_nearest():
    points = torch.tensor([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]])
    scene = NearestPointSearch(points, points, 0.15)
    exact = scene.query(torch.tensor([[0.0, 0.01, 2.0], [0.1, 0.02, 2.0], [0.0, 0.0, 3.0]]))
    worse = replace(exact, distance=exact.distance + torch.tensor([0.002, 0.004, 0.0]))
    assert nearest_errors_mm(exact, exact) == {"mean error mm": 0, "largest mm": 0, "missed %": 0}
    assert nearest_errors_mm(worse, exact) == pytest.approx(
        {"mean error mm": 3, "largest mm": 4, "missed %": 0}, abs=1e-3
    )
    lost = replace(exact, found=torch.tensor([True, False, False]))
    assert nearest_errors_mm(lost, exact)["missed %"] == pytest.approx(33.333)


@pytest.fixture(scope="module")
def report():
    return measure_speed(1, sections=("nearest", "size", "cuda"), sizes=("240p",), size=SMALL)


def test_a_speed_report_has_the_requested_sections(report):
    assert {row.section for row in report.rows} <= {"nearest", "size", "cuda"}
    names = [row.name for row in report.rows if row.section == "nearest"]
    assert names == [
        "plain search in chunks",
        "plain search, only of points near the people",
        "k-d tree, bounded (default)",
    ]
    exact = report.row("nearest", "k-d tree, bounded (default)").numbers
    assert exact["largest mm"] < 1e-3
    assert exact["missed %"] == 0
    assert report.row("size", "240p").numbers["evaluations"] > 0
    if not torch.cuda.is_available():
        assert "CUDA: there is none on this machine, so it was not measured." in report.notes
    assert torch.get_num_threads() >= 1


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"repeats": 0}, "at least one round is needed, got 0"),
        (
            {"sections": ("flor",)},
            "no section named 'flor': choose among floor, nearest, people, size, threads, cuda",
        ),
        ({"sizes": ("144p",)}, "no size named '144p': choose among 240p, 480p, 720p, 1080p"),
        ({"people": (9,)}, "people must be numbers from 1 to 8 and sizes names, at least one of each"),
        ({"preset": "best"}, "no engine preset named 'best'; there are: default, paper, prox, release"),
    ],
)
def test_invalid_speed_arguments_are_refused(asked, message):
    with pytest.raises(ConfigError) as caught:
        measure_speed(**asked)
    assert str(caught.value) == message
