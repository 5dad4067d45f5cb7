"""Known-size terms: tight constraints on statures, the camera's height and lengths given by the user."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.sizes import linearise_stature, stature_prior
from physic_core.engine.sizes.evidence import KNOWN_SIZE_SIGMA
from physic_core.engine.sizes.known_sizes import BodyEnds


class KnownSizeTerm(Term):
    """Squared deviations of log sizes from the known ones, in units of :data:`KNOWN_SIZE_SIGMA`."""

    def __init__(self, context: JointContext) -> None:
        problem = context.problem
        assert problem.known is not None
        self._known, self._K = problem.known, problem.K
        self._floor_offset = problem.floor_offset
        self._stature = linearise_stature(problem.model, problem.betas0)
        self._ends: list[BodyEnds] = []

    def refresh(self, snapshot: Snapshot) -> None:
        """Choose the vertices of people at the pixels of known lengths."""
        self._ends = self._known.distances.ends_on_bodies(snapshot.vertices, snapshot.visibility.normals, self._K)

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energies "known_stature" and "known_scene"; the second is divided equally among the people."""
        known, estimate = self._known, bodies.estimate
        given = torch.isfinite(known.stature)
        stature = torch.where(given, known.stature, self._stature.height)
        own = stature_prior(self._stature(estimate.betas), stature, KNOWN_SIZE_SIGMA) * given
        shared = own.new_zeros(())
        if known.camera_height is not None and self._floor_offset:
            height = estimate.log_scale + math.log(self._floor_offset / known.camera_height)
            shared = shared + (height / KNOWN_SIZE_SIGMA).square()
        extents = known.distances.measure(self._ends, bodies.vertices, estimate.log_scale.exp())
        for extent, metres in zip(extents, known.distances.metres, strict=False):
            shared = shared + ((extent.clamp(min=1e-3) / metres).log() / KNOWN_SIZE_SIGMA).square()
        return {"known_stature": own, "known_scene": (shared / len(own)).expand(len(own))}
