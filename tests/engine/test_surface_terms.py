"""The terms of vertices with their derivative written out are those of the plain functions, to the last digits."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
import torch

from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.presets import PRESETS

DEFAULT = replace(PRESETS["default"].joint, nearest_every_step=False)
SETTINGS = {
    "default": DEFAULT,
    "metres": replace(DEFAULT, scene_unit="metres"),
    "frozen": replace(DEFAULT, frozen=("scale", "warp", "offset")),
    "no plane": replace(DEFAULT, floor="points"),
    "neither contact nor mesh": replace(DEFAULT, contact_weight=0.0, regularisation_weight=0.0),
    "contact alone": replace(DEFAULT, depth_weight=0.0, penetration_weight=0.0, floor_weight=0.0),
    "squares": replace(DEFAULT, depth_loss="square", contact_loss="square", penetration_loss="square"),
    "other losses": replace(DEFAULT, depth_loss="barron", contact_loss="pseudo_huber", penetration_loss="cauchy"),
    "absolute": replace(DEFAULT, depth_loss="absolute", contact_loss="barron", penetration_loss="absolute"),
}
UNALIKE = (0.7, 1.3)  # what the gradient of each person's energy is multiplied by


@pytest.fixture(scope="module")
def sunk(make_stage):
    """Two who stand partly in a box and in the floor, one of them with hidden feet, in float64."""
    stage = make_stage([({}, (-0.6, 0.0, 3.2)), ({}, (0.5, 0.0, 3.8))], boxes=[((-0.9, 0.8, 3.3), (0.9, 1.3, 3.6))])
    problem = replace(stage.problem, transl0=stage.problem.transl0 + torch.tensor([0.01, 0.03, 0.08]))
    double = {
        f.name: value.double()
        for f in fields(problem)
        if isinstance(value := getattr(problem, f.name), torch.Tensor) and value.is_floating_point()
    }
    return replace(problem, model=problem.model.to(dtype=torch.float64), **double)


def somewhere(energy: JointEnergy) -> None:
    here = energy.state.pack()
    noise = torch.randn(len(here), generator=torch.Generator().manual_seed(3), dtype=here.dtype)
    energy.state.load(here + 0.1 * noise)


def slopes(energy: JointEnergy, value: torch.Tensor) -> list[torch.Tensor]:
    parameters = energy.state.parameters()
    weights = torch.tensor(UNALIKE, dtype=value.dtype)[: len(value)]
    found = torch.autograd.grad((weights * value).sum(), parameters, allow_unused=True, retain_graph=True)
    return [torch.zeros_like(p) if g is None else g for g, p in zip(found, parameters, strict=True)]


@pytest.mark.parametrize("name", SETTINGS)
def test_written_out_and_plain_are_one(sunk, name):
    energy = JointEnergy(sunk, SETTINGS[name])
    somewhere(energy)
    fast = energy()
    energy._written_out = False
    plain = energy()
    assert list(fast) == list(plain)
    assert {"reprojection", "limits"} < set(plain)
    for term, value in plain.items():
        torch.testing.assert_close(fast[term], value, rtol=1e-9, atol=1e-12, msg=term)
        if value.requires_grad:
            for ours, theirs in zip(slopes(energy, fast[term]), slopes(energy, value), strict=True):
                torch.testing.assert_close(ours, theirs, rtol=1e-7, atol=1e-9, msg=term)


def test_every_term_has_something_to_say_there(sunk):
    energy = JointEnergy(sunk, DEFAULT)
    somewhere(energy)
    for term, value in energy().items():
        if term in ("depth", "contact", "penetration", "floor", "soles", "regularisation"):
            assert value.detach().max() > 0, term


def test_without_a_scene_there_is_the_floor(sunk):
    nothing = sunk.scene_points.new_zeros(0, 3)
    energy = JointEnergy(replace(sunk, scene_points=nothing, scene_normals=nothing), DEFAULT)
    somewhere(energy)
    fast = energy()
    energy._written_out = False
    plain = energy()
    assert fast["penetration"].eq(0).all()
    assert fast["floor"].gt(0).all()
    for term, value in plain.items():
        torch.testing.assert_close(fast[term], value, rtol=1e-9, atol=1e-12, msg=term)


@pytest.mark.parametrize("preset", ["paper", "release", "prox"])
def test_distances_to_points_are_left_to_the_plain_functions(sunk, preset):
    assert not JointEnergy(sunk, PRESETS[preset].joint)._written_out
