"""Stage 3: joint optimisation of people and scene (paper Sec. 3.3).

Other packages use ``optimize`` and ``finalize_scene`` of :mod:`.solve`. An energy replaces the
``JointStageMethod`` of :mod:`.method`; its terms are of the class in :mod:`.term` and read
:mod:`.sampling`, :mod:`.variables` and :mod:`.snapshot`; those of the default energy are in
:mod:`.terms`. :mod:`.optimiser` minimises it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.lazy import importer

if TYPE_CHECKING:
    from physic_core.engine.joint.method import JointStageMethod as JointStageMethod
    from physic_core.engine.joint.method import TermWeight as TermWeight
    from physic_core.engine.joint.optimiser import BlockResult as BlockResult
    from physic_core.engine.joint.optimiser import EnergyTerms as EnergyTerms
    from physic_core.engine.joint.optimiser import LbfgsOptimiser as LbfgsOptimiser
    from physic_core.engine.joint.optimiser import MinimisationResult as MinimisationResult
    from physic_core.engine.joint.optimiser import Optimiser as Optimiser
    from physic_core.engine.joint.optimiser import StepProgress as StepProgress
    from physic_core.engine.joint.optimiser import energy_per_person as energy_per_person
    from physic_core.engine.joint.optimiser import join_results as join_results
    from physic_core.engine.joint.optimiser import total_energy as total_energy
    from physic_core.engine.joint.sampling import Sampling as Sampling
    from physic_core.engine.joint.sampling import VisibilitySettings as VisibilitySettings
    from physic_core.engine.joint.sampling import root_relative as root_relative
    from physic_core.engine.joint.sampling import with_static_contacts as with_static_contacts
    from physic_core.engine.joint.snapshot import HIDDEN_LIMB_SHARE as HIDDEN_LIMB_SHARE
    from physic_core.engine.joint.snapshot import ContactState as ContactState
    from physic_core.engine.joint.snapshot import OcclusionTracker as OcclusionTracker
    from physic_core.engine.joint.snapshot import Visibility as Visibility
    from physic_core.engine.joint.snapshot import update_visibility as update_visibility
    from physic_core.engine.joint.term import PosedBodies as PosedBodies
    from physic_core.engine.joint.term import RobustLoss as RobustLoss
    from physic_core.engine.joint.term import Snapshot as Snapshot
    from physic_core.engine.joint.term import Term as Term
    from physic_core.engine.joint.terms.priors import LimitTerm as LimitTerm
    from physic_core.engine.joint.terms.priors import SceneScaleTerm as SceneScaleTerm
    from physic_core.engine.joint.terms.priors import parameter_energy as parameter_energy
    from physic_core.engine.joint.terms.priors import vertex_weights as vertex_weights
    from physic_core.engine.joint.terms.reprojection_and_depth import (
        ReprojectionTerm as ReprojectionTerm,
    )
    from physic_core.engine.joint.terms.reprojection_and_depth import (
        finite_keypoints as finite_keypoints,
    )
    from physic_core.engine.joint.terms.reprojection_and_depth import (
        weights_inside_image as weights_inside_image,
    )
    from physic_core.engine.joint.variables import BODY as BODY
    from physic_core.engine.joint.variables import FACE as FACE
    from physic_core.engine.joint.variables import HANDS as HANDS
    from physic_core.engine.joint.variables import Estimate as Estimate
    from physic_core.engine.joint.variables import Variables as Variables

_NAMES = {
    "method": "JointStageMethod TermWeight",
    "optimiser": "BlockResult EnergyTerms LbfgsOptimiser MinimisationResult Optimiser StepProgress "
    "energy_per_person join_results total_energy",
    "sampling": "Sampling VisibilitySettings root_relative with_static_contacts",
    "snapshot": "ContactState HIDDEN_LIMB_SHARE OcclusionTracker Visibility update_visibility",
    "term": "PosedBodies RobustLoss Snapshot Term",
    "terms.priors": "LimitTerm SceneScaleTerm parameter_energy vertex_weights",
    "terms.reprojection_and_depth": "ReprojectionTerm finite_keypoints weights_inside_image",
    "variables": "BODY Estimate FACE HANDS Variables",
}

__getattr__ = importer(__name__, _NAMES)
