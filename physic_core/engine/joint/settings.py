"""Settings of stage 3 that all presets share: frozen parameters and optimiser."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

from physic_core.engine.bounds import Count, Degrees, FrozenGroups, NotNegative, Positive, PositiveCount

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyOutput
    from physic_core.engine.joint.context import JointContext, Keypoints
    from physic_core.engine.joint.energy_options import EnergyOptions
    from physic_core.engine.joint.problem import JointProblem
    from physic_core.engine.joint.state import State
    from physic_core.engine.joint.term import Term
    from physic_core.engine.joint.visibility import SelfOcclusion, Visibility

__all__ = ["AdamSettings", "JointSettings", "LbfgsSettings", "VisibilitySettings"]


@dataclass(frozen=True)
class LbfgsSettings:
    """Settings of L-BFGS with a backtracking (Armijo) line search.

    Attributes:
        steps: at most; 40-100.
        refresh_steps: steps between two updates of visibility and nearest points; 10-30.
        tolerance: stop when the steps between two updates lower the energy by less than this share; 0 never stops.
    """

    steps: Count = 80
    refresh_steps: PositiveCount = 20
    tolerance: NotNegative = 5e-3


@dataclass(frozen=True)
class AdamSettings:
    """Settings of Adam, the optimiser of the paper.

    Attributes:
        steps: all of them are taken.
        refresh_steps: steps between two updates of visibility.
        learning_rate: of the raw parameters.
    """

    steps: Count = 100
    refresh_steps: PositiveCount = 30
    learning_rate: Positive = 1e-2


@dataclass(frozen=True)
class VisibilitySettings:
    """Settings of the visibility of vertices.

    Attributes:
        vertex_spacing_m: vertices without contact are subsampled to this spacing, metres; 0 keeps all.
        facing_deg: a vertex faces the camera when its normal is within this angle of the direction to the camera.
        mask_tolerance: vertices this share of the person outside their mask still count as visible.
        occlusion_aware: hidden vertices are left out of penetration and regularised more.
    """

    vertex_spacing_m: NotNegative = 0.02
    facing_deg: Degrees = 70.0
    mask_tolerance: NotNegative = 0.01
    occlusion_aware: bool = True


@dataclass(frozen=True)
class JointSettings(ABC):
    """Settings of stage 3, the joint optimisation of people and scene (paper sec. 3.3, Eq. 5-7).

    A preset of the engine is a subclass: its fields are the settings of its terms, and :meth:`terms` lists them.

    Attributes:
        frozen: parameter groups that are kept constant: root, pose, hands, betas, translation, scale, offset.
        optimiser: of the energy.
    """

    frozen: FrozenGroups = ()
    optimiser: LbfgsSettings | AdamSettings = field(default_factory=LbfgsSettings)

    scene_start_share: ClassVar[float] = 0.0
    """Share of the steps before contact and penetration are added; 0 includes them from the first step."""

    @property
    @abstractmethod
    def energy_options(self) -> EnergyOptions:
        """Options of this preset's energy, such as its vertices, limbs and floor."""

    @abstractmethod
    def weigh_keypoints(self, problem: JointProblem, person_px: Tensor, observed: Tensor) -> Keypoints:
        """Return the keypoints and their weights.

        Args:
            problem: with finite people only.
            person_px: (B,) stature in px.
            observed: (B, 55) bool, joints that count as visible.
        """

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

    def late_terms(self, context: JointContext, state: State) -> Sequence[Term]:
        """Return the terms that are added after the others have converged. By default there is none."""
        return ()

    def without(self, term: str) -> Self:
        """Return a copy with the weight of one term set to 0, if the energy has such a term."""
        return replace(self, **{term: replace(getattr(self, term), weight=0.0)}) if hasattr(self, term) else self
