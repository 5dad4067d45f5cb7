"""Joint energy of people and scene: the sum of its terms (paper Eq. 5)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from physic_core.engine.joint.method import JointStageMethod
from physic_core.engine.joint.prepare_sampling import precompute_sampling
from physic_core.engine.joint.snapshot import (
    MAX_MOTION_M,
    OcclusionTracker,
    Visibility,
    update_contacts,
)
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.terms.people import connected_groups
from physic_core.engine.joint.terms.reprojection_and_depth import ViewsTerm
from physic_core.engine.state import State
from physic_core.errors import PhysicError

_MARGIN_M = 0.1  # of MAX_MOTION_M that is left when the search structure is built again


class JointEnergy:
    """Energy of B people and their scene, as a function of its :attr:`variables`.

    Between two calls of :meth:`refresh` visibility and the weights of each term stay fixed. Nearest
    points stay fixed as well, unless ``JointStageMethod.finds_nearest_every_step`` is set. The
    energy is then smooth, as a line search needs it.

    Args:
        state: with finite people only.
        settings: of stage 3, which list the terms.

    Attributes:
        variables: the free parameters.
        terms: summands of the energy.
        scene: search structure of the scene points near the people.
        snapshot: visibility, nearest points and distances that the terms were refreshed with.

    Raises:
        PhysicError: data of a term is missing, or the energy does not use the views of the state.
    """

    def __init__(self, state: State, settings: JointStageMethod) -> None:
        self.state = state
        self._settings = settings
        self.sampling = precompute_sampling(state, settings)
        self.variables = settings.initial_variables(self.sampling)
        weights = self.sampling.person_weights
        self._people = None if (weights == 1).all() else weights
        self.terms = tuple(settings.terms(self.sampling, self.variables))
        if state.known is not None:  # known sizes are a part of every energy
            from physic_core.engine.joint.terms.priors import KnownSizeTerm

            self.terms = (*self.terms, KnownSizeTerm(self.sampling))
        if state.views and not any(isinstance(term, ViewsTerm) for term in self.terms):
            raise PhysicError("only the engine preset 'default' uses other cameras: omit its views")
        self._gathered = self.sampling.start.vertices
        self.scene = settings.nearby_scene(self.sampling, self._gathered, 1.0)
        self._self_occlusion = OcclusionTracker(self.sampling)
        self._visibility: Visibility | None = None
        self.snapshot: Snapshot
        self.refresh()

    @torch.no_grad()
    def add_terms(self, terms: Sequence[Term]) -> Tensor | None:
        """Add terms.

        Returns:
            (B,) int64, group of each person: people who are linked by these terms; None if no term
            is positive at this state.
        """
        for term in terms:
            term.refresh(self.snapshot)
        self.terms = (*self.terms, *terms)
        bodies = self._posed_bodies()
        if not any(bool((value > 0).any()) for term in terms for value in term(bodies).values()):
            return None
        links = torch.cat([term.links for term in terms])
        return connected_groups(links, len(self.state))

    @property
    def weights(self) -> dict[str, Tensor]:
        """Weights of vertices, feet or people in each term: term name -> (B, n) or (B,)."""
        return {name: weight for term in self.terms for name, weight in term.weights.items()}

    @torch.no_grad()
    def refresh(self) -> None:
        """Update visibility, nearest points and the weights of each term at the current state."""
        state = self.state
        sampling = self.sampling
        estimate = self.variables.unpack()
        bodies = state.model(estimate.rotations, estimate.betas, estimate.transl, state.expression)
        scale = float(estimate.log_scale.exp())
        unscaled = bodies.vertices / scale
        if not (unscaled - self._gathered).abs().amax() < MAX_MOTION_M - _MARGIN_M:
            self._gathered = unscaled
            self.scene = self._settings.nearby_scene(sampling, bodies.vertices, scale)
        self._visibility = self._settings.update_visibility(
            sampling, bodies, self._self_occlusion, self._visibility
        )
        self._update(self._visibility, bodies.vertices[:, sampling.ids], scale)

    def _update(self, visibility: Visibility, vertices: Tensor, scale: float) -> None:
        """Update nearest points and the weights of each term."""
        contacts = update_contacts(self.sampling, visibility.normals, self.scene, vertices, scale)
        self.snapshot = Snapshot(visibility, contacts, vertices, scale)
        for term in self.terms:
            term.refresh(self.snapshot)

    def __call__(self) -> dict[str, Tensor]:
        """Return the weighted energies at the current state: term -> (B,), and "scale" -> (1,).

        Differentiable.
        """
        bodies = self._posed_bodies()
        if self._settings.finds_nearest_every_step:
            scale = float(bodies.estimate.log_scale.detach().exp())
            self._update(self.snapshot.visibility, bodies.vertices.detach(), scale)
        energies = {name: value for term in self.terms for name, value in term(bodies).items()}
        if self._people is None:
            return energies
        return {
            name: value * self._people if len(value) > 1 else value
            for name, value in energies.items()
        }

    def _posed_bodies(self) -> PosedBodies:
        """Return bodies and scene parameters at the current state, differentiable."""
        state = self.state
        estimate = self.variables.unpack()
        posed = self.sampling.pose(
            estimate.rotations, estimate.betas, estimate.transl, state.expression
        )
        people, scale = self.variables.deviation()
        return PosedBodies(
            posed["vertices"], posed["joints"], posed[state.skeleton], estimate, people, scale
        )
