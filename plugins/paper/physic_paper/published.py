"""What the published energies share: raw parameters, and the scene as points.

Each rotation is the first two columns of its matrix, as in the paper's gradient descent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from physic_core.engine.joint import (
    BODY,
    FACE,
    HANDS,
    Estimate,
    JointStageMethod,
    Sampling,
    Variables,
)
from physic_core.engine.scene_state import Surroundings
from physic_core.engine.state import State
from physic_paper.contact import with_floor_samples


class UnwhitenedVariables(Variables):
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
class PublishedJointStage(JointStageMethod):
    """Settings that "paper", "release" and "prox" share.

    Raw parameters, all limbs visible, people who count alike, and nearest points at every
    evaluation, among all points of the scene and samples of the floor.
    """

    finds_nearest_every_step = True
    samples_floor = True
    """Whether samples of the floor are among the points of the scene; otherwise there is none."""

    def prepare(self, state: State) -> State:
        """Return the state with all limbs visible."""
        return replace(state, observed=torch.ones_like(state.observed))

    def select_surroundings(self, state: State) -> Surroundings:
        """Return all finite points of the scene, and no plane of the floor."""
        surroundings = state.surroundings
        finite = torch.isfinite(surroundings.points).all(-1) & torch.isfinite(
            surroundings.normals
        ).all(-1)
        points = surroundings.points[finite]
        normals = surroundings.normals[finite]
        surroundings = replace(surroundings, points=points, normals=normals, depth=None)
        if self.samples_floor:
            return with_floor_samples(surroundings)
        return replace(surroundings, floor=None)

    def weigh_people(self, state: State) -> Tensor:
        """Return 1 for each person."""
        return torch.ones_like(state.transl[:, 2])

    def initial_variables(self, sampling: Sampling) -> Variables:
        """Return raw parameters without depth offsets; without a scene, its scale is constant as
        well.
        """
        state = sampling.state
        constant = {*self.frozen, "offset"} | (
            set() if len(sampling.surroundings.points) else {"scale"}
        )
        start = (state.rotations, state.betas, state.transl, sampling.start.joints[:, 0])
        return UnwhitenedVariables(*start, frozen=sorted(constant))
