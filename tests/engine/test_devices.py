"""The engine on another device than the CPU: what runs at every step touches that device alone, and
CUDA agrees.
"""

from __future__ import annotations

import copy

import pytest
import torch
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import total_energy
from physic_core.engine.joint.solve import optimize
from physic_core.geometry.tensors import to_device

from .adjusted import adjusted, shifted, with_options
from .drawn import normal

DEFAULT = engine_preset("default").joint
HERE = {
    "default": DEFAULT,
    "points": with_options(engine_preset("prox").joint, finds_nearest_every_step=False),
}
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")


@pytest.mark.parametrize("name", HERE)
def test_an_evaluation_stays_on_one_device(with_box, name, monkeypatch):
    """Without a GPU: tensors without content refuse to meet those of the CPU."""
    energy = JointEnergy(with_box.state, HERE[name])
    expected = energy()
    monkeypatch.setattr(
        torch.Tensor,
        "__deepcopy__",
        lambda here, _: here.detach().to("meta").requires_grad_(here.requires_grad),
    )
    there = copy.deepcopy(energy)
    found = there()
    assert set(found) == set(expected)
    assert all(value.device.type == "meta" for value in found.values())
    gradients = torch.autograd.grad(
        total_energy(found), there.variables.parameters(), allow_unused=True
    )
    assert all(g.device.type == "meta" for g in gradients if g is not None)


def as_double(state, device):
    return to_device(state, device, torch.float64)


@needs_cuda
@pytest.mark.parametrize("name", [*HERE, "paper"])
def test_cuda_has_the_cpus_energy(with_box, name):
    settings = HERE.get(name, engine_preset("paper").joint)
    here, there = (JointEnergy(as_double(with_box.state, d), settings) for d in ("cpu", "cuda"))
    for energy in (here, there):
        packed = energy.variables.pack()
        energy.variables.load(packed + 0.01 * normal(len(packed)).to(packed))
        energy.refresh()
    mine = here()
    theirs = there()
    for term, value in mine.items():
        assert_close(theirs[term].cpu(), value, rtol=1e-6, atol=1e-8)


@needs_cuda
def test_cuda_ends_where_the_cpu_does(with_box):
    state = shifted(with_box.state, 0.0, -0.05, 0.1)
    here, there = (
        optimize(as_double(state, d), adjusted(DEFAULT, optimiser__steps=30))
        for d in ("cpu", "cuda")
    )
    assert (there.vertices.cpu() - here.vertices).norm(dim=-1).amax() < 2e-3
    assert there.unapplied_scene_scale == pytest.approx(here.unapplied_scene_scale, abs=1e-3)
