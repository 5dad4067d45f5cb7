"""The joint energy is the sum of its terms (paper Eq. 5)."""

from __future__ import annotations

from collections.abc import Collection

import torch
from torch import Tensor

from physic_core.engine.joint.contact_state import WANDER_M, ContactState, scene_near, update_contacts
from physic_core.engine.joint.context import precompute
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.settings import JointSettings
from physic_core.engine.joint.term import PosedBodies, View
from physic_core.engine.joint.visibility import SelfOcclusion, Visibility, occluded_vertices

__all__ = ["JointEnergy"]

_MARGIN_M = 0.1  # the search structure is built again this far before its margin is used up


class JointEnergy:
    """Energy of B people and their scene, as a function of its :attr:`state`.

    Between two calls of :meth:`refresh` visibility and the weights of each term stay fixed. Nearest points stay fixed
    as well, unless ``Conventions.nearest_every_step`` is set. The energy is then smooth, as a line search needs it.

    Args:
        problem: with finite people only.
        settings: of stage 3; they list the terms.

    Attributes:
        context: constants of this optimisation.
        state: the free parameters.
        terms: of the energy.
        visibility: of the vertices, at the last refresh.
        contacts: nearest points and distances, at the last refresh or evaluation.
        scene: search structure of the scene points near the people.
        evaluations: calls so far.

    Raises:
        PhysicError: a term lacks its data.
    """

    def __init__(self, problem: JointProblem, settings: JointSettings) -> None:
        self.problem = problem
        self.evaluations = 0
        self.context = precompute(problem, settings.conventions)
        self.state = settings.initial_state(self.context)
        self.terms = tuple(settings.terms(self.context, self.state))
        self.excluded: Collection[str] = ()
        self.visibility: Visibility
        self.contacts: ContactState
        self._gathered = self.context.start.vertices
        self.scene = scene_near(self.context, self._gathered, 1.0)
        self._self_occlusion = SelfOcclusion(self.context)
        self._has_visibility = False
        self.refresh()

    @property
    def active(self) -> dict[str, Tensor]:
        """Weights of vertices, feet or people in each term, by the names that the terms give them."""
        return {name: weight for term in self.terms for name, weight in term.active.items()}

    @torch.no_grad()
    def refresh(self) -> None:
        """Update visibility, nearest points and the weights of each term at the present state."""
        problem, context = self.problem, self.context
        estimate = self.state.unpack()
        bodies = problem.model(estimate.rotations, estimate.betas, estimate.transl, problem.expression0)
        scale = float(estimate.log_scale.exp())
        unscaled = bodies.vertices / scale
        if not (unscaled - self._gathered).abs().amax() < WANDER_M - _MARGIN_M:
            self._gathered = unscaled
            self.scene = scene_near(context, bodies.vertices, scale)
        last = self.visibility if self._has_visibility else None
        self.visibility = context.conventions.update_visibility(context, bodies, self._self_occlusion, last)
        self._has_visibility = True
        self._update(bodies.vertices[:, context.ids], scale, estimate.warp)

    def _update(self, vertices: Tensor, scale: float, warp: Tensor) -> None:
        self.contacts = update_contacts(self.context, self.visibility.normals, self.scene, vertices, scale, warp)
        view = View(self.visibility, self.contacts, vertices, scale)
        for term in self.terms:
            term.refresh(view)

    def occluded(self, vertices: Tensor) -> Tensor:
        """(B, V) bool, which of all vertices (B, V, 3) the camera does not see."""
        return occluded_vertices(self.context, vertices, self._self_occlusion)

    def __call__(self) -> dict[str, Tensor]:
        """Weighted energies at the present state: name -> (B,), and "scale" -> (1,). Differentiable."""
        self.evaluations += 1
        context, estimate = self.context, self.state.unpack()
        posed = context.pose(estimate.rotations, estimate.betas, estimate.transl, self.problem.expression0)
        vertices = posed["vertices"]
        if context.conventions.nearest_every_step:
            self._update(vertices.detach(), float(estimate.log_scale.detach().exp()), estimate.warp.detach())
        people, scale = self.state.deviation()
        bodies = PosedBodies(vertices, posed["joints"], posed[self.problem.skeleton], estimate, people, scale)
        energies = {name: value for term in self.terms for name, value in term(bodies).items()}
        return {name: value for name, value in energies.items() if name not in self.excluded}
