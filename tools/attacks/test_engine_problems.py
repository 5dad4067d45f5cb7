"""The engine on a few of the random problems of ``engine_problems.py``."""

from __future__ import annotations

import pytest
import torch

from engine_problems import check_engine, few_steps, random_estimates
from physic_core import engine_preset_names

SEEDS = (0, 1, 2, 3, 4, 7, 10, 11, 19, 21, 43)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_finite_result_or_an_error(seed: int) -> None:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        check_engine(random_estimates(seed), few_steps(engine_preset_names()[seed % len(engine_preset_names())]))
    finally:
        torch.set_num_threads(threads)


def test_problems_differ_in_people() -> None:
    assert {len(random_estimates(seed).people) for seed in SEEDS} >= {0, 1, 2, 3}
