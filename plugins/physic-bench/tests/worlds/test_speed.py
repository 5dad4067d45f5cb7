"""What ``physic bench speed`` measures: its structure, its problems and its errors; never how long anything took."""

from __future__ import annotations

import pytest
import torch

from physic_bench.worlds.speed import measure_speed
from physic_bench.worlds.synthetic_problems import make_joint_problem
from physic_core import engine_preset
from physic_core.body import load_body
from physic_core.engine.joint.solve import optimize
from physic_core.engine.settings import with_overrides
from physic_core.errors import ConfigError

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


@pytest.fixture(scope="module")
def report():
    return measure_speed(1, sections=("floor", "people"), people=(1,), size=SMALL)


def test_a_speed_report_has_the_requested_sections(report):
    assert [(row.section, row.name) for row in report.rows] == [
        ("floor", "100 passes"),
        ("floor", "stage 3"),
        ("people", "1 person"),
    ]
    assert report.row("people", "1 person").numbers["evaluations"] > 0
    assert torch.get_num_threads() >= 1


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"repeats": 0}, "at least one round is needed, got 0"),
        (
            {"sections": ("flor",)},
            "no section named 'flor': choose among floor, people",
        ),
        ({"people": (9,)}, "people must be numbers from 1 to 8, at least one"),
        ({"preset": "best"}, "no engine preset named 'best'; there are: default, paper, prox, release"),
    ],
)
def test_invalid_speed_arguments_are_refused(asked, message):
    with pytest.raises(ConfigError) as caught:
        measure_speed(**asked)
    assert str(caught.value) == message
