"""Raw parameters: each rotation as the first two columns of its matrix, as in the paper's gradient descent."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.state import BODY, FACE, HANDS, Estimate, State

__all__ = ["UnwhitenedState", "build_unwhitened_state"]


class UnwhitenedState(State):
    """Free parameters in their own units; the scale is the factor on the scene, not its logarithm."""

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
        """Convert the free parameters to bodies and scene; two columns of a rotation are orthonormalised."""
        import roma  # which imports torch._dynamo, for longer than a second

        start, values = self.start, self.values
        body_and_hands = [roma.special_gramschmidt(values[group]) for group in ("pose", "hands")]
        first = roma.special_gramschmidt(values["root"])[:, None]
        return Estimate(
            torch.cat([first, body_and_hands[0], start.rotations[:, FACE], body_and_hands[1]], 1),
            values["betas"],
            values["translation"],
            values["scale"].clamp(min=1e-3).log(),
            values["offset"] * self.offset_free.to(start.transl.dtype),
        )


def build_unwhitened_state(context: JointContext, frozen: Sequence[str]) -> UnwhitenedState:
    """Build a state with unwhitened parameters, without depth offsets.

    The groups ``frozen`` are constant, and the scale as well if there is neither scene nor floor.
    """
    problem = context.problem
    constant = {*frozen, "offset"}
    if not len(context.surface) and problem.floor_normal is None:
        constant.add("scale")
    start = (problem.rotations0, problem.betas0, problem.transl0, context.start.joints[:, 0])
    return UnwhitenedState(*start, frozen=sorted(constant))
