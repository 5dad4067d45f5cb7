"""The rows of the paper's ablation: what each goes without, and that each runs."""

from __future__ import annotations

from dataclasses import asdict
from itertools import pairwise

import pytest
import torch

from physic_bench.worlds.ablation import ablation_rows
from physic_core import engine_preset
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted, with_scene

STAGES = ("scene", "placement", "joint", "contact")


def difference(one, other):
    """{stage.field} in which two settings differ."""

    def differing(path, a, b):
        if isinstance(a, dict):
            return {name for key in a for name in differing(f"{path}.{key}", a[key], b[key])}
        return {path} if a != b else set()

    return {
        name
        for stage in STAGES
        for name in differing(stage, asdict(getattr(one, stage)), asdict(getattr(other, stage)))
    }


def rows(base):
    """Label -> settings of a preset's rows, without the row of the estimators' own bodies."""
    return {row.label: row.settings for row in ablation_rows(base)[1:]}


@pytest.mark.parametrize("base", ["paper", "default", "release"])
def test_rows_are_the_papers_and_end_in_the_full_model(base):
    found = rows(base)
    terms = ["L_reg + L_j2d", "+ L_c", "+ L_i", "+ L_d", "+ occ. aware L_i", "+ floor (full model)"]
    assert list(found) == [*terms, "PROX", "static contacts"]
    assert found["+ floor (full model)"] == engine_preset(base)
    assert found["PROX"] == engine_preset("prox")


def test_each_row_adds_one_term_to_the_row_before():
    papers = list(rows("paper").values())
    steps = [difference(a, b) for a, b in pairwise(papers[:6])]
    assert steps[:2] == [{"joint.contact.weight"}, {"joint.penetration.weight"}]
    assert steps[2] == {"placement.chamfer_weight", "joint.depth.weight"}
    assert steps[3:] == [{"joint.visibility.occlusion_aware"}, {"scene.floor"}]
    ours = list(rows("default").values())
    assert difference(ours[3], ours[4]) == {"joint.visibility.occlusion_aware"}
    assert difference(ours[5], ours[7]) == {"joint.contact.source"}


@pytest.mark.parametrize("full", rows("default").values(), ids=rows("default"))
def test_every_row_runs_and_tells_its_terms(standing, full):
    # As the pipeline does where stage 1 looks for no floor.
    state = with_scene(standing.state, floor=None) if full.scene.floor == "off" else standing.state
    settings = adjusted(full.joint, optimiser__steps=8, optimiser__refresh_steps=4)
    result = optimize(state, settings)
    assert result.failures == ("",)
    assert torch.isfinite(result.vertices).all()
    wanted = {
        "contact": settings.contact.weight,
        "penetration": settings.penetration.weight,
        "depth": settings.depth.weight if hasattr(settings, "depth") else 0.0,
        "floor": settings.floor.weight
        if hasattr(settings, "floor") and full.scene.floor != "off"
        else 0.0,
    }
    assert {name for name in wanted if name in result.losses} == {
        name for name, weight in wanted.items() if weight
    }
