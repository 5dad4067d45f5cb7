"""What the published energies share: raw parameters, and the scene as points.

Each rotation is the first two columns of its matrix, as in the paper's gradient descent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.method import JointMethod
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.state import BODY, FACE, HANDS, Estimate, State
from physic_paper.contact import with_floor_samples


class UnwhitenedState(State):
    """Free parameters in their own units; the scale is the factor on the scene, not its
    logarithm.
    """

    def _initial_values(self) -> dict[str, Tensor]:
        start = self.start
        columns = start.rotations[..., :2]
        return {
            "root": columns[:, 0].clone(),
            "pose": columns[:, BODY].clone(),
            "hands": columns[:, HANDS].clone(),
            "betas": start.betas.clone(),
            "translation": start.transl.clone(),
            "scale": torch.ones_like(start.log_scale),
            "offset": start.offset.clone(),
        }

    def unpack(self) -> Estimate:
        """Convert the free parameters to bodies and scene; two columns of a rotation are
        orthonormalised.
        """
        import roma  # which imports torch._dynamo, for longer than a second

        start = self.start
        values = self.values
        body_and_hands = [roma.special_gramschmidt(values[group]) for group in ("pose", "hands")]
        first = roma.special_gramschmidt(values["root"])[:, None]
        log_scale = values["scale"].clamp(min=1e-3).log()
        return Estimate(
            torch.cat([first, body_and_hands[0], start.rotations[:, FACE], body_and_hands[1]], 1),
            values["betas"],
            values["translation"],
            log_scale,
            values["offset"],
            log_scale.expand(len(values["offset"])),
        )


@dataclass(frozen=True)
class PublishedOptimisation(JointMethod):
    """Settings that "paper", "release" and "prox" share.

    Raw parameters, all limbs visible, people who count alike, and nearest points at every
    evaluation, among all points of the scene and samples of the floor.
    """

    nearest_every_step: ClassVar[bool] = True

    def prepare(self, problem: JointProblem) -> JointProblem:
        """Return the problem with all limbs visible, and samples of the floor among the scene
        points.
        """
        finite = torch.isfinite(problem.scene_points).all(-1) & torch.isfinite(
            problem.scene_normals
        ).all(-1)
        problem = replace(
            problem,
            observed=torch.ones_like(problem.observed),
            scene_points=problem.scene_points[finite],
            scene_normals=problem.scene_normals[finite],
            scene_depth=None,
        )
        return replace(with_floor_samples(problem), floor_normal=None)

    def weigh_people(self, problem: JointProblem) -> Tensor:
        """Return 1 for each person."""
        return torch.ones_like(problem.transl0[:, 2])

    def initial_state(self, context: JointContext) -> State:
        """Return raw parameters without depth offsets; without a scene, its scale is constant as
        well.
        """
        problem = context.problem
        constant = {*self.frozen, "offset"} | (set() if len(problem.scene_points) else {"scale"})
        start = (problem.rotations0, problem.betas0, problem.transl0, context.start.joints[:, 0])
        return UnwhitenedState(*start, frozen=sorted(constant))
