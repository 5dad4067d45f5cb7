"""Known-size terms: statures, the camera's height and lengths that the user gave hold within their tight sigma."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.engine.sizes import BodyPoint, linearise_stature, stature_prior, vertices_at_ray

KNOWN_SIGMA = 0.002
"""Expected error of the logarithm of a known size; 1 % off costs 25, as much as ten keypoints on a wrong limb."""


class KnownSizeTerm(Term):
    """Squared deviations of log sizes from the known ones, in units of :data:`KNOWN_SIGMA`."""

    def __init__(self, context: JointContext) -> None:
        problem = context.problem
        assert problem.known is not None
        self._known, self._K = problem.known, problem.K
        self._floor_offset = problem.floor_offset
        self._stature = linearise_stature(problem.model, problem.betas0)
        self._ends: list[tuple[BodyPoint | None, ...]] = []

    def refresh(self, snapshot: Snapshot) -> None:
        """Choose the vertices of people at the pixels of known lengths."""
        d, normals = self._known.distances, snapshot.visibility.normals
        self._ends = [
            tuple(
                vertices_at_ray(snapshot.vertices[person], normals[person], ray, self._K) if person >= 0 else None
                for person, ray in zip(people, rays, strict=True)
            )
            for people, rays in zip(d.person.tolist(), d.rays, strict=True)
        ]

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energies "known_stature" and "known_scene"; the second is divided equally among the people."""
        known, estimate = self._known, bodies.estimate
        given = torch.isfinite(known.stature)
        stature = torch.where(given, known.stature, self._stature.height)
        own = stature_prior(self._stature(estimate.betas), stature, KNOWN_SIGMA) * given
        shared = own.new_zeros(())
        if known.camera_height is not None and self._floor_offset:
            height = estimate.log_scale + math.log(self._floor_offset / known.camera_height)
            shared = shared + (height / KNOWN_SIGMA).square()
        for i, ends in enumerate(self._ends):
            d = known.distances
            start, end = (
                d.points[i, side] * estimate.log_scale.exp() if on is None else on(bodies.vertices[person])
                for side, (on, person) in enumerate(zip(ends, d.person[i].tolist(), strict=True))
            )
            extent = torch.linalg.vector_norm(start - end).clamp(min=1e-3)
            shared = shared + ((extent / d.metres[i]).log() / KNOWN_SIGMA).square()
        return {"known_stature": own, "known_scene": (shared / len(own)).expand(len(own))}
