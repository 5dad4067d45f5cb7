"""The fused energies of the surface have the values and gradients of the reference, to the last
digits.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.sampling import select_surface
from physic_core.engine.joint.terms import surface

from .adjusted import adjusted, in_float64, shifted, with_options, with_scene
from .drawn import normal
from .reference_energies import reference_surface_energies

pytestmark = pytest.mark.quick

DEFAULT = engine_preset("default").joint
SETTINGS = {
    "default": DEFAULT,
    "frozen": adjusted(DEFAULT, frozen=("scale", "offset")),
    "no plane": with_options(
        DEFAULT,
        select_surroundings=lambda self, state: select_surface(
            replace(state.surroundings, floor=None)
        ),
    ),
    "no contact": adjusted(DEFAULT, contact__weight=0.0),
    "contact alone": adjusted(
        DEFAULT, depth__weight=0.0, penetration__weight=0.0, floor__weight=0.0
    ),
}
UNALIKE = (0.7, 1.3)  # what the gradient of each person's energy is multiplied by


@pytest.fixture(scope="module")
def sunk(with_box):
    """Two who stand partly in a box and in the floor, one of them with hidden feet, in float64."""
    state = shifted(with_box.state, 0.01, 0.03, 0.08)
    return in_float64(state)


def somewhere(energy):
    here = energy.variables.pack()
    energy.variables.load(here + 0.1 * normal(len(here), seed=3))


def slopes(energy, value):
    parameters = energy.variables.parameters()
    weights = torch.tensor(UNALIKE, dtype=value.dtype)[: len(value)]
    total = (weights * value).sum()
    return torch.autograd.grad(
        total, parameters, materialize_grads=True, retain_graph=True, allow_unused=True
    )


@pytest.fixture
def compared(monkeypatch):
    """Return a function that compares the fused and the reference energies of a joint energy."""

    def compare(energy):
        somewhere(energy)
        fused = energy()
        with monkeypatch.context() as patch:
            patch.setattr(surface, "surface_energies", reference_surface_energies)
            return assert_alike(energy, fused, energy())

    return compare


def assert_alike(energy, fused, reference):
    """Values and gradients are equal; return the fused energies."""
    assert list(fused) == list(reference)
    for term, value in reference.items():
        assert_close(fused[term], value, rtol=1e-9, atol=1e-12, msg=term)
        if value.requires_grad:
            found = slopes(energy, fused[term])
            assert_close(found, slopes(energy, value), rtol=1e-7, atol=1e-9, msg=term)
    return fused


@pytest.mark.parametrize("name", SETTINGS)
def test_fused_and_reference_energies_are_alike(sunk, compared, name):
    found = compared(JointEnergy(sunk, SETTINGS[name]))
    assert {"reprojection", "limits"} < set(found)
    assert ("floor" in found) == (name not in ("no plane", "contact alone"))


def test_without_a_scene_there_is_the_floor(sunk, compared):
    empty = with_scene(sunk, valid=torch.zeros_like(sunk.scene.valid))
    energies = compared(JointEnergy(empty, DEFAULT))
    assert energies["penetration"].eq(0).all()
    assert energies["floor"].gt(0).all()
