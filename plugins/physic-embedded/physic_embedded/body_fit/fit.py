"""Bodies fitted to 2D keypoints and 3D landmarks, all people in one optimisation.

Every unknown is divided by its expected size first: on such whitened unknowns L-BFGS comes near a minimum in about 80
iterations where on raw ones it stalls. Newton's method then finds the minimum itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_embedded.body_fit.newton import converge
from physic_embedded.body_fit.problem import fit_problem

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.types import Skeleton
    from physic_embedded.body_fit.problem import FitSettings, Start
    from physic_embedded.body_fit.views import Views

    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating]

__all__ = ["BodyFit", "fit_bodies"]


@dataclass(frozen=True)
class BodyFit:
    """Fitted bodies, torch tensors of the model's float type, camera frame, metres.

    Attributes:
        rotations: (N, 55, 3, 3).
        betas: (N, K).
        transl: (N, 3).
        joints: (N, 55, 3).
        loss: (N,) at the end, what the floor says left out, so that fits with and without it compare.
        reprojection: (N,) mean distance of confident keypoints in sizes of the person.
        lean: (N,) radians that the landmarks were turned about the view's x axis.
        landmark_size: (N,) how much larger the body is than its landmarks.
    """

    rotations: Tensor
    betas: Tensor
    transl: Tensor
    joints: Tensor
    loss: FloatArray
    reprojection: FloatArray
    lean: FloatArray
    landmark_size: FloatArray


def fit_bodies(
    model: BodyModel,
    views: Views,
    camera: FloatArray,
    skeleton: Skeleton,
    start: Start,
    settings: FitSettings,
    *,
    floor_up: FloatArray | None = None,
    stands: BoolArray | None = None,
    lean: FloatArray | None = None,
    starts: int = 1,
) -> BodyFit:
    """Fit N bodies.

    Args:
        model: the body, float64.
        views: what is seen of the people.
        camera: (3, 3) px.
        skeleton: joint set of the keypoints.
        start: first guess.
        settings: numbers.
        floor_up: (3,) the floor's normal, camera frame; None where there is no floor.
        stands: (N,) people who must come out upright; None for nobody.
        lean: (N,) radians about the view's x axis by which the landmarks are turned before the fit.
        starts: how many starts each person has: N is the number of people times this, one start of all people after
            the other. The best one of each person is kept.

    Returns:
        The fit of each person.
    """
    problem = fit_problem(model, views, camera, skeleton, start, settings, floor_up, stands, lean)
    unknowns = torch.zeros(len(views.points), problem.width, dtype=model.dtype, requires_grad=True)
    optimiser = torch.optim.LBFGS(
        [unknowns],
        max_iter=settings.iterations,
        max_eval=settings.iterations * 5 // 4,
        history_size=20,
        line_search_fn="strong_wolfe",
        tolerance_change=1e-6,
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        total = problem.loss(unknowns).sum()
        total.backward()  # type: ignore[no-untyped-call]
        return total

    optimiser.step(closure)  # type: ignore[no-untyped-call]
    with torch.no_grad():
        best = problem.loss(unknowns).view(starts, -1).argmin(0)
    rows = best * len(best) + torch.arange(len(best))
    problem = problem.pick(rows)
    found = converge(problem, unknowns.detach()[rows])
    with torch.no_grad():
        loss, _, projected = problem.terms(found)
        body = problem.body(found)
        seen = (problem.confidence > 0.5).to(model.dtype)
        miss = (projected - problem.points).norm(dim=-1) * seen
        joints = model(body.rotations, body.betas, body.transl, joints_only=True).joints
        return BodyFit(
            body.rotations.detach(),
            body.betas.detach(),
            body.transl.detach(),
            joints,
            loss.double().numpy(),
            (miss.sum(1) / seen.sum(1).clamp(min=1) / problem.size).double().numpy(),
            body.lean.double().numpy(),
            body.landmark_size.double().numpy(),
        )
