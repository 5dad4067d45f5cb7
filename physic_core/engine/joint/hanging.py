"""Hypothesis that a person hangs from the hands, judged together with the pose.

A bar is a few pixels wide, so that the point map rarely has it. The terms of the feet then pull a person who hangs from
it to the floor. People with both hands above the head are therefore optimised twice: with feet that may stand on the
floor, and with feet in the air. They hang if surfaces and depth agree better with feet in the air.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.body.joints import JOINT_INDEX, joint_pair
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.optimiser import MinimisationResult
from physic_core.engine.joint.schedule import minimise_with_schedule
from physic_core.engine.joint.settings import JointSettings

__all__ = ["JudgedSupports", "judge_hanging"]

_HEAD, _WRISTS = JOINT_INDEX["head"], joint_pair("wrist")

_COMPARED = ("contact", "soles", "floor", "depth")
"""Terms that are compared: of surfaces and of depth. Two minimisations end with keypoint errors and deviations from the
start that differ by more than the two hypotheses."""

_COST = 3.5
"""Energy by which these terms must be lower with feet in the air.

Of people who stand with raised arms they are lower by 2.7 at most, of most people who hang from a bar by 5 to 71.
"""


@dataclass(frozen=True)
class JudgedSupports:
    """Energy of the better hypothesis of each person, at its minimum.

    Attributes:
        energy: with the feet of people who hang in the air.
        minimised: result of all minimisations.
        hanging: (B,) bool, people who hang from their hands.
    """

    energy: JointEnergy
    minimised: MinimisationResult
    hanging: Tensor


def judge_hanging(energy: JointEnergy, settings: JointSettings, minimised: MinimisationResult) -> JudgedSupports:
    """Find the people who hang from their hands, and minimise the energy with their feet in the air.

    Nobody is a candidate if the feet in the air are known already, or without a floor.

    Args:
        energy: at its minimum.
        settings: of stage 3.
        minimised: result of the minimisation.
    """
    hanging = _candidates(energy)
    if not bool(hanging.any()):
        return JudgedSupports(energy, minimised, hanging)
    before, result = _surface_energies(energy), minimised
    while bool(hanging.any()):
        # From the same start: the depth of feet on the floor and that of the depth map are different minima.
        lifted = JointEnergy(energy.problem.lift_feet(hanging), settings)
        found = minimise_with_schedule(lifted, settings)
        result = replace(found, evaluations=result.evaluations + found.evaluations, steps=result.steps + found.steps)
        confirmed = hanging & (before - _surface_energies(lifted) > _COST)
        if torch.equal(confirmed, hanging):
            return JudgedSupports(lifted, result, hanging)
        hanging = confirmed
    return JudgedSupports(energy, minimised, hanging)


@torch.no_grad()
def _candidates(energy: JointEnergy) -> Tensor:
    """Return the people (B,) bool with both wrists in sight and above the head."""
    problem, estimate = energy.problem, energy.state.unpack()
    up = energy.context.floor_normal
    if up is None or problem.lifted_feet is not None:
        return torch.zeros(len(problem), dtype=torch.bool, device=problem.transl0.device)
    joints = energy.context.pose(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)["joints"]
    raised = ((joints[:, _WRISTS] - joints[:, [_HEAD]]) @ up > 0).all(1)
    return raised & problem.observed[:, _WRISTS].bool().all(1)


@torch.no_grad()
def _surface_energies(energy: JointEnergy) -> Tensor:
    """Return the sum (B,) of the compared terms of each person."""
    energies = energy()
    return sum((energies[name] for name in _COMPARED if name in energies), torch.zeros_like(energy.context.area[:, 0]))
