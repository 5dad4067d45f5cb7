"""The steps of stage 3, and the settings shared by all energies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import torch
from torch import Tensor

from physic_core.body.model import BodyOutput
from physic_core.engine.joint.optimiser import Optimiser
from physic_core.engine.joint.sampling import (
    Sampling,
    VisibilitySettings,
    select_surface,
)
from physic_core.engine.joint.snapshot import (
    MAX_MOTION_M,
    OcclusionTracker,
    Visibility,
    update_visibility,
)
from physic_core.engine.joint.term import Term
from physic_core.engine.joint.variables import Variables
from physic_core.engine.scene_state import Surroundings
from physic_core.engine.state import State
from physic_core.geometry.neighbors import NearestPointSearch, inside_body_boxes
from physic_core.types.bounds import FrozenGroups, NotNegative

# Least size in px of a person over that of the largest: the optimiser would stop before smaller
# ones converge.
_LEAST_SIZE = 0.1
_AREA_UNIT_M2 = 0.01  # surface of weight 1: a square decimetre, half a sole


@dataclass(frozen=True)
class TermWeight:
    """Settings of a term that has only a weight."""

    weight: NotNegative
    """Weight of the term; 0 removes it."""


@dataclass(frozen=True)
class JointStageMethod(ABC):
    """Settings of stage 3, the joint optimisation of people and scene (paper sec. 3.3, Eq. 5-7).

    An energy is a subclass: its fields are the settings of its terms, and :meth:`terms` lists them.
    An energy may override the other methods; by default they do the same as preset "default".
    """

    frozen: FrozenGroups = ()
    """Parameter groups kept constant: root, pose, hands, betas, translation, scale, offset."""
    optimiser: Optimiser = field(kw_only=True)
    """Optimiser of the energy."""
    visibility: VisibilitySettings = VisibilitySettings()
    """Visibility of vertices."""

    finds_nearest_every_step: ClassVar[bool] = False
    """Whether nearest points are searched at every evaluation rather than only when visibility is
    updated.
    """

    @property
    @abstractmethod
    def search_radius_m(self) -> float:
        """Search radius of vertices for scene points, metres."""

    def prepare(self, state: State) -> State:
        """Return the state as the energy uses it, such as with other contacts."""
        return state

    def select_surroundings(self, state: State) -> Surroundings:
        """Return the surfaces that distances are measured to."""
        return select_surface(state.surroundings)

    def weigh_people(self, state: State) -> Tensor:
        """Return the weight (B,) of each person in the energy: the size in the photo, relative to
        the largest person.

        The scale of the scene then follows the people who are most visible.
        """
        # A sum over the pixels of Booleans takes twenty times as long.
        sides = torch.stack([mask.count_nonzero() for mask in state.masks]).sqrt()
        return (sides / sides.amax().clamp(min=1)).clamp(min=_LEAST_SIZE)

    @abstractmethod
    def weigh_keypoints(self, state: State) -> Tensor:
        """Return the weights (B, J) of the keypoints, 0 for those that do not count.

        Args:
            state: from :meth:`prepare`, with finite people only.
        """

    def weigh_vertices(self, area_m2: Tensor) -> Tensor:
        """Return the weight (B, n) of each vertex from its surface (B, n): square decimetres."""
        return area_m2 / _AREA_UNIT_M2

    def nearby_scene(
        self, sampling: Sampling, vertices: Tensor, scale: float
    ) -> NearestPointSearch:
        """Return the search structure of the scene points near people (B, V, 3), metres, at a scale
        of the scene.

        A margin is left for the motion of people.
        """
        surroundings = sampling.surroundings
        radius = self.search_radius_m
        keep = inside_body_boxes(
            surroundings.points, vertices / scale, (radius + MAX_MOTION_M) / scale
        )
        return NearestPointSearch(surroundings.points[keep], surroundings.normals[keep], radius)

    def update_visibility(
        self,
        sampling: Sampling,
        bodies: BodyOutput,
        self_occlusion: OcclusionTracker,
        last: Visibility | None,
    ) -> Visibility:
        """Return the visibility of the posed bodies.

        Args:
            bodies: posed at the current state, all vertices.
            self_occlusion: of the B people.
            last: the last visibility; None at the first update.
        """
        return update_visibility(sampling, bodies, self_occlusion)

    @abstractmethod
    def initial_variables(self, sampling: Sampling) -> Variables:
        """Return the free parameters at the start."""

    @abstractmethod
    def terms(self, sampling: Sampling, variables: Variables) -> Sequence[Term]:
        """Return the terms of the energy, in the order of summation."""

    def late_terms(self, sampling: Sampling) -> tuple[Sequence[Term], Optimiser, Optimiser]:
        """Return terms added after the others have converged, and the optimisers of the energy
        without and with them.

        Minimisation is not repeated if all of them are 0 then. By default there are none.
        """
        return (), self.optimiser, self.optimiser

    def with_fixed_bodies(self) -> Self:
        """Return the settings with poses and shapes of all people kept constant."""
        return replace(self, frozen=(*self.frozen, "root", "pose", "hands", "betas"))

    def without(self, term: str) -> Self:
        """Return a copy with the weight of one term set to 0, if the energy has such a term."""
        return (
            replace(self, **{term: replace(getattr(self, term), weight=0.0)})
            if hasattr(self, term)
            else self
        )
