"""Settings of stage 3 that all energies share: frozen parameters and optimiser."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

from physic_core.engine.bounds import Count, Degrees, FrozenGroups, NotNegative, PositiveCount

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyOutput
    from physic_core.engine.joint.acceptance import Energy
    from physic_core.engine.joint.context import JointContext, Keypoints
    from physic_core.engine.joint.energy import JointEnergy
    from physic_core.engine.joint.energy_options import EnergyOptions
    from physic_core.engine.joint.optimiser import MinimisationResult
    from physic_core.engine.joint.problem import JointProblem
    from physic_core.engine.joint.state import State
    from physic_core.engine.joint.term import Term
    from physic_core.engine.joint.visibility import SelfOcclusion, Visibility
    from physic_core.geometry.neighbors import NearestPointSearch

__all__ = ["JointSettings", "OptimiserSettings", "Progress", "VisibilitySettings"]

_AREA_UNIT_M2 = 0.01  # surface of weight 1: a square decimetre, half a sole

Progress = Callable[[float], None]
"""Called with the completed share of the work, 0-1."""


@dataclass(frozen=True)
class OptimiserSettings(ABC):
    """Settings of a minimiser of the energy."""

    steps: Count
    """At most."""
    refresh_steps: PositiveCount
    """Steps between two updates of visibility and nearest points."""

    @abstractmethod
    def minimise(
        self, energy: Energy, progress: Progress | None = None, groups: Tensor | None = None
    ) -> MinimisationResult:
        """Minimise an energy by changing its state in place.

        Args:
            energy: refreshed, and finite at its present state.
            progress: called with the completed share of the steps.
            groups: (B,) int64 of people who touch each other; the end is kept or reverted for all people of a group.
        """


@dataclass(frozen=True)
class VisibilitySettings:
    """Settings of the visibility of vertices."""

    vertex_spacing_m: NotNegative = 0.02
    """Vertices without contact are subsampled to this spacing, metres; 0 keeps all."""
    facing_deg: Degrees = 70.0
    """A vertex faces the camera when its normal is within this angle of the direction to the camera."""
    mask_tolerance: NotNegative = 0.01
    """Vertices this share of the person outside their mask still count as visible."""
    occlusion_aware: bool = True
    """Hidden vertices are left out of penetration and regularised more."""


@dataclass(frozen=True)
class JointSettings(ABC):
    """Settings of stage 3, the joint optimisation of people and scene (paper sec. 3.3, Eq. 5-7).

    An energy is a subclass: its fields are the settings of its terms, and :meth:`terms` lists them. The other methods
    are what an energy may do in its own way; by default they do what preset "default" does.
    """

    frozen: FrozenGroups = ()
    """Parameter groups that are kept constant: root, pose, hands, betas, translation, scale, offset."""
    optimiser: OptimiserSettings = field(kw_only=True)
    """Optimiser of the energy."""

    nearest_every_step: ClassVar[bool] = False
    """Whether nearest points are searched at every evaluation, not only when visibility is updated."""

    @property
    @abstractmethod
    def energy_options(self) -> EnergyOptions:
        """Options of the energy, such as its vertices and the facing angle."""

    def prepare(self, problem: JointProblem) -> JointProblem:
        """Return the problem as the energy uses it, such as without its floor."""
        return problem

    @abstractmethod
    def weigh_keypoints(self, problem: JointProblem, person_px: Tensor) -> Keypoints:
        """Return the keypoints and their weights.

        Args:
            problem: from :meth:`prepare`, with finite people only.
            person_px: (B,) stature in px.
        """

    def weigh_vertices(self, area_m2: Tensor) -> Tensor:
        """Return the weight (B, n) of each vertex from its surface (B, n): square decimetres."""
        return area_m2 / _AREA_UNIT_M2

    def nearby_scene(self, context: JointContext, vertices: Tensor, scale: float) -> NearestPointSearch:
        """Return the search structure of the scene points near people (B, V, 3), metres, at a scale of the scene."""
        from physic_core.engine.joint.contact_state import nearby_scene

        return nearby_scene(context, vertices, scale)

    def update_visibility(
        self, context: JointContext, bodies: BodyOutput, self_occlusion: SelfOcclusion, last: Visibility | None
    ) -> Visibility:
        """Return the visibility of the posed bodies.

        Args:
            bodies: posed at the present state, all vertices.
            self_occlusion: of the B people.
            last: the last visibility; None at the first update.
        """
        from physic_core.engine.joint.visibility import update_visibility

        return update_visibility(context, bodies, self_occlusion)

    @abstractmethod
    def initial_state(self, context: JointContext) -> State:
        """Return the free parameters at the start."""

    @abstractmethod
    def terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Return the terms of the energy, in the order of summation."""

    def minimise(self, energy: JointEnergy, progress: Progress | None = None) -> MinimisationResult:
        """Minimise the energy from its present state, in place."""
        return self.optimiser.minimise(energy, progress)

    def without(self, term: str) -> Self:
        """Return a copy with the weight of one term set to 0, if the energy has such a term."""
        return replace(self, **{term: replace(getattr(self, term), weight=0.0)}) if hasattr(self, term) else self
