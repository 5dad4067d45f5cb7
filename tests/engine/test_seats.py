"""Seats reach farther than other skin: people who sit are pulled to a level surface that depth has placed apart."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted
from .conftest import FLOOR_Y

NO_SOLES = {f"soles__{name}": 0.0 for name in ("weight", "lower_weight", "unseen_weight")}
DEFAULT = adjusted(engine_preset("default").joint, depth__weight=0.0, contact__static_weight=0.0, **NO_SOLES)
SITS = {f"{side}_hip": (-1.5, 0.0, 0.0) for side in ("left", "right")}  # with straight knees
TOP_Y = FLOOR_Y - 0.3


def seat_of(problem) -> torch.Tensor:
    """Vertices of buttocks and thighs."""
    return torch.cat([problem.model.contact_sets[name] for name in ("gluteus", "thighs")])


def over_a_box(make_stage, gap_m: float, top_y: float = TOP_Y):
    """A person who sits at a height over the top of a box, with nothing that says where the feet are."""
    boxes = [((-1.5, top_y, 2.6), (1.5, FLOOR_Y, 4.5))] if top_y < FLOOR_Y else []
    problem = make_stage([(SITS, (0.0, 0.0, 3.2))], boxes=boxes).problem
    vertices = problem.model(problem.rotations0, problem.betas0, problem.transl0).vertices
    lowest = vertices[0, seat_of(problem), 1].max()
    up = torch.tensor([0.0, 1.0, 0.0]) * (top_y - gap_m - lowest)
    probability = torch.zeros_like(problem.contact_probability)
    probability[:, seat_of(problem)] = 0.5
    return replace(
        problem,
        transl0=problem.transl0 + up,
        contact_probability=probability,
        keypoint_confidence=torch.zeros_like(problem.keypoint_confidence),
        foot_touch=torch.zeros(1, 2),
    )


def gap_m(problem, vertices: torch.Tensor, top_y: float = TOP_Y) -> float:
    return float(top_y - vertices[0, seat_of(problem), 1].max())


def test_a_seat_that_is_20_cm_over_a_box_comes_down_to_it(make_stage):
    problem = over_a_box(make_stage, 0.2)
    assert gap_m(problem, optimize(problem, DEFAULT).vertices) == pytest.approx(0.0, abs=0.06)
    short = adjusted(DEFAULT, contact__seat_distance_m=DEFAULT.contact.max_distance_m)
    assert gap_m(problem, optimize(problem, short).vertices) == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("changes", ["far", "floor", "not sitting"])
def test_what_is_far_the_floor_and_people_who_do_not_sit_do_not_pull(make_stage, changes: str):
    top_y, start_m = (FLOOR_Y, 0.2) if changes == "floor" else (TOP_Y, 0.4 if changes == "far" else 0.2)
    problem = over_a_box(make_stage, start_m, top_y)
    if changes == "not sitting":
        problem = replace(problem, contact_probability=0.4 * (problem.contact_probability > 0).float())
    assert gap_m(problem, optimize(problem, DEFAULT).vertices, top_y) == pytest.approx(start_m, abs=0.01)
