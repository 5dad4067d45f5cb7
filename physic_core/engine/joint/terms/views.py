"""Reprojection term of all other cameras: projected joints of the body against their keypoints (paper Eq. 2)."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Term
from physic_core.engine.joint.terms.reprojection import ReprojectionSettings, ReprojectionTerm


class ViewsTerm(Term):
    """Sum of the reprojection terms of all other cameras, with the weight and loss of the photo's term."""

    def __init__(self, settings: ReprojectionSettings, context: JointContext) -> None:
        self._terms = [
            (view, ReprojectionTerm(own, settings.weight, own.person_px[:, None] * settings.sigma, settings.rho()))
            for view, own in zip(context.problem.views, context.views, strict=True)
        ]

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "views"."""
        scale = bodies.estimate.log_scale.exp()
        found: list[Tensor] = []
        for view, term in self._terms:
            found += term(replace(bodies, keypoints=view.to_camera(bodies.keypoints, scale))).values()
        return {"views": torch.stack(found).sum(0)} if found else {}
