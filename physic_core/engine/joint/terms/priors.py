"""Terms on bodies and sizes: deviation from the start (L_reg), limits of joints, statures, known
sizes, scene scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.body.joints import MAX_FLEXION, PARENTS, joint_pair
from physic_core.engine.joint.sampling import Sampling
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.joint.variables import DEPTH_SIGMA, RAY_SIGMA, Variables
from physic_core.engine.sizes.evidence import KNOWN_SIZE_SIGMA
from physic_core.engine.sizes.stature import linearise_stature, stature_prior
from physic_core.engine.state import State
from physic_core.types.bounds import NotNegative, Positive

if TYPE_CHECKING:
    from physic_core.engine.sizes.known_sizes import BodyEnds

_HIDDEN_VERTEX_WEIGHT = 0.05  # of hidden vertices, and of those on invisible limbs
_PARAMETER_WEIGHTS = {"root": 0.3, "pose": 1.0, "hands": 1.0, "betas": 1.0, "offset": 1.0}
"""Weights of the deviations of each group of parameters from the start."""

STATED_WEIGHT = 20.0
"""Weight of a deviation as large as the error that the body estimator states.

It is more than the 1 of independent errors: those of a photo's depth, floor and keypoints are
common to all vertices and keypoints, which the other terms count one by one.
"""
_LEAST_ROTATION_SIGMA = 0.01  # radians
_ERRORS = 6
"""Errors, three axes of two joints, whose squares add up to that of a joint relative to another."""


@dataclass(frozen=True)
class RegularisationSettings:
    """Settings of the regularisation term: deviation of root-relative mesh and parameters from the
    start.
    """

    sigma_m: Positive = 0.06
    """Expected change of a vertex of weight 1, root-relative, metres."""
    visible_weight: NotNegative = 0.01
    """Weight of visible vertices."""
    translation_weight: NotNegative = 0.05
    """Weight of the translation."""


def parameter_energy(deviation: Tensor, weight: Tensor) -> Tensor:
    """Return the L_reg of parameter deviations (B, P), whitened or raw: ``sum_i w_i x_i^2`` (B,),
    weights (P,).
    """
    return deviation.square() @ weight


def vertex_weights(
    sampling: Sampling, snapshot: Snapshot, visible: float, occluded: float
) -> Tensor:
    """Return the L_reg weight of each vertex (B, n): vertex area times ``visible``, or ``occluded``
    if not visible.
    """
    strong = ~snapshot.visibility.eligible
    if sampling.visibility.occlusion_aware:
        strong = strong | snapshot.visibility.hidden
    return torch.where(strong, occluded, visible).to(sampling.area.dtype) * sampling.area


def stated_weights(state: State, expected: Tensor) -> Tensor:
    """Return the weights (B, 22) of the rotations of pelvis and body joints, by the errors that the
    estimator states.

    NaN where it states none, and where the photo shows no joint that the rotation moves, unless
    the user gives the body.

    Args:
        state: of B people.
        expected: (22,) radians, expected angles of correction, in which deviations are measured.
    """
    if state.rotation_sigma is None:
        return expected.new_full((len(state), len(expected)), torch.nan)
    children = [
        [j for j, parent in enumerate(PARENTS) if parent == i] or [i] for i in range(len(expected))
    ]
    is_visible = torch.stack([state.observed[:, moved].any(1) for moved in children], 1)
    is_visible = is_visible | state.is_given[:, None]
    sigma = state.rotation_sigma.to(expected).clamp(min=_LEAST_ROTATION_SIGMA)
    return torch.where(is_visible, STATED_WEIGHT * (expected / sigma).square(), torch.nan)


def given_weights(state: State, distance: Tensor) -> Tensor:
    """Return the weights (B, K + 3) of shape and translation of bodies that the user gives; 0 of
    others.

    The pelvis is as far off across its ray as any joint: their distances from the true ones,
    relative to each other, are what the file states.

    Args:
        state: of B people.
        distance: (B,) metres, of the pelvis at the start.
    """
    shape = torch.ones_like(state.betas)
    if state.distance_sigma is None or state.joint_sigma is None:
        return shape.new_zeros(len(shape), shape.shape[1] + 3)
    across = (RAY_SIGMA * distance / state.joint_sigma[:, 0])[:, None] * math.sqrt(_ERRORS)
    along = (DEPTH_SIGMA / state.distance_sigma.clamp(min=KNOWN_SIZE_SIGMA))[:, None]
    weights = STATED_WEIGHT * torch.cat([shape, across, across, along], 1).square()
    return torch.where(state.is_given[:, None], weights, 0.0)


class RegularisationTerm:
    """Regularisation term, evaluated by
    :class:`physic_core.engine.joint.terms.fused_surface.SurfaceTerms`.

    The squared error of a start decreases with its number n of photos: all weights are n times
    those for one photo.
    """

    def __init__(
        self, settings: RegularisationSettings, sampling: Sampling, variables: Variables
    ) -> None:
        self._settings = settings
        self._sampling = sampling
        self._photos = sampling.state.photo_counts
        self._prior_weight = variables.expand_to_parameters(
            _PARAMETER_WEIGHTS | {"translation": settings.translation_weight}
        )
        stated = stated_weights(sampling.state, variables.expected_turns).repeat_interleave(3, 1)
        added = stated - self._prior_weight[: stated.shape[1]]
        self._stated_beyond_prior = torch.where(added.isfinite(), added, 0.0)
        self._given_weights = given_weights(sampling.state, sampling.start.joints[:, 0, 2])
        self.weights: dict[str, Tensor] = {}

    def refresh(self, snapshot: Snapshot) -> None:
        """Update the weights of visible and hidden vertices."""
        s = self._settings
        weight = vertex_weights(self._sampling, snapshot, s.visible_weight, _HIDDEN_VERTEX_WEIGHT)
        self.weights = {"regularisation": self._photos[:, None] * weight / s.sigma_m**2}

    def energy(self, mesh: Tensor, deviation: Tensor) -> Tensor:
        """Return the energy (B,): the mesh energy ``mesh`` (B,) plus the energy of parameter
        deviations (B, P).
        """
        turns = deviation[:, : self._stated_beyond_prior.shape[1]]
        stated = (self._stated_beyond_prior * turns.square()).sum(1)
        # The last columns are those of shape, translation and depth offset.
        placed = deviation[:, -1 - self._given_weights.shape[1] : -1]
        stated = stated + (self._given_weights * placed.square()).sum(1)
        return mesh + self._photos * (parameter_energy(deviation, self._prior_weight) + stated)


# Entries of the 55 rotation matrices, flattened: knees turn by rows 2 and 1 of column 1, elbows by
# rows 2 and 0 of column 0. One gather of eight numbers has a cheap gradient.
_HINGE_SINES = [9 * joint + 7 for joint in joint_pair("knee")] + [
    9 * joint + 6 for joint in joint_pair("elbow")
]
_HINGE_COSINES = [9 * joint + 4 for joint in joint_pair("knee")] + [
    9 * joint for joint in joint_pair("elbow")
]
_HINGE_SIGNS = (1.0, 1.0, 1.0, -1.0)


def hinge_angles(rotations: Tensor) -> Tensor:
    """Return the flexion of left knee, right knee, left elbow, right elbow: (B, 55, 3, 3) -> (B, 4)
    radians.

    0 is straight. Knees bend about x, elbows about y (the left one in the opposite direction).
    Twist about the limb's own axis is ignored.
    """
    entries = torch.tensor(_HINGE_SINES + _HINGE_COSINES)
    sine, cosine = torch.split(rotations.flatten(1).index_select(1, entries), 4, dim=1)
    return torch.atan2(sine * sine.new_tensor(_HINGE_SIGNS), cosine)


_FLEXION_SIGMA = 1.0 / 12.0  # radians, about 5 degrees


def limit_energy(rotations: Tensor) -> Tensor:
    """Return the penalty on flexion angles outside 0 to 2.7 rad: (B, 55, 3, 3) -> (B,).

    ``sum_h (max(0, -a_h)^2 + max(0, a_h - 2.7)^2) / sigma^2`` over knees and elbows.
    """
    angle = hinge_angles(rotations)
    beyond = angle - angle.clamp(0.0, MAX_FLEXION)
    return (beyond / _FLEXION_SIGMA).square().sum(-1)


class LimitTerm(Term):
    """Limit term of all knees and elbows."""

    def __init__(self, weight: float) -> None:
        self._weight = weight

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "limits"."""
        return (
            {"limits": self._weight * limit_energy(bodies.estimate.rotations)}
            if self._weight
            else {}
        )


class StatureTerm(Term):
    """Stature term of all people: deviation of each person's height from the body estimator's
    result.
    """

    def __init__(self, weight: float, sampling: Sampling) -> None:
        self._weight = weight
        self._stature = (
            linearise_stature(sampling.state.model, sampling.state.betas) if weight else None
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "stature"."""
        if self._stature is None:
            return {}
        prior = stature_prior(self._stature(bodies.estimate.betas), self._stature.height)
        return {"stature": self._weight * prior}


class KnownSizeTerm(Term):
    """Squared deviations of log sizes from the known ones, in units of :data:`KNOWN_SIZE_SIGMA`."""

    def __init__(self, sampling: Sampling) -> None:
        state = sampling.state
        assert state.known is not None
        self._known = state.known
        self._K = state.K
        self._floor = state.scene.floor
        self._stature = linearise_stature(state.model, state.betas)
        self._ends: list[BodyEnds] = []

    def refresh(self, snapshot: Snapshot) -> None:
        """Choose the vertices of people at the pixels of known lengths."""
        self._ends = self._known.distances.ends_on_bodies(
            snapshot.vertices, snapshot.visibility.normals, self._K
        )

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energies "known_stature" and "known_scene"; the second is divided equally
        among the people.
        """
        known = self._known
        estimate = bodies.estimate
        is_known = torch.isfinite(known.stature)
        stature = torch.where(is_known, known.stature, self._stature.height)
        own_energy = (
            stature_prior(self._stature(estimate.betas), stature, KNOWN_SIZE_SIGMA) * is_known
        )
        shared = own_energy.new_zeros(())
        if known.camera_height is not None and self._floor is not None:
            height = estimate.log_scale + math.log(self._floor.offset / known.camera_height)
            shared = shared + (height / KNOWN_SIZE_SIGMA).square()
        if known.depth_sigma is not None:
            shared = shared + (estimate.log_scale / KNOWN_SIZE_SIGMA).square()
        extents = known.distances.measure(self._ends, bodies.vertices, estimate.log_scale.exp())
        for extent, metres in zip(extents, known.distances.metres, strict=False):
            shared = shared + ((extent.clamp(min=1e-3) / metres).log() / KNOWN_SIZE_SIGMA).square()
        return {
            "known_stature": own_energy,
            "known_scene": (shared / len(own_energy)).expand(len(own_energy)),
        }


class SceneScaleTerm(Term):
    """Scene-scale term ``w x^2``; ``x`` is the deviation of the scale from the initial scale
    (``State.deviation``).
    """

    def __init__(self, weight: float) -> None:
        self._weight = weight

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "scale", (1,)."""
        return {"scale": self._weight * bodies.scale_deviation.square().reshape(1)}
