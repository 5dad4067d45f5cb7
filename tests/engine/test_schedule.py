"""When terms join the joint optimisation."""

from __future__ import annotations

import pytest

from physic_core import engine_preset
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize

from .adjusted import adjusted, shifted

JOINT, PROX = (engine_preset(name).joint for name in ("default", "prox"))


def test_prox_adds_contact_after_three_quarters_of_the_steps_with_its_loss_at_the_true_start(two):
    state = shifted(two.state, 0.0, 0.06, 0.0)
    prox = adjusted(PROX, optimiser__steps=6, optimiser__refresh_steps=2)
    progress = []
    late = optimize(state, prox, progress.append)
    assert progress == sorted(progress)
    assert progress[-1] == 1.0
    alone = optimize(state, adjusted(prox, contact__weight=0.0, penetration__weight=0.0))
    assert {"contact", "penetration"} <= set(late.joint.losses)
    assert set(alone.joint.losses) == set(late.joint.losses) - {"contact", "penetration"}
    assert late.joint.steps == 8
    energy = JointEnergy(state, prox)
    energy.add_terms(prox.late_terms(energy.sampling)[0])
    start = energy()["contact"].sum().item()
    assert late.joint.losses["contact"][0] == pytest.approx(start, rel=0.05)
