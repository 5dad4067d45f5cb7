"""One body for each person from several photos: a shape, a pose and a place that fit the keypoints of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.body.parameters import parameters_from_rotations
from physic_core.geometry.camera import project
from physic_core.geometry.robust import robust_loss
from physic_core.geometry.rotations import rotvec_to_rotmat
from physic_scene.rigid import mean_rotation

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body.model import BodyModel
    from physic_core.types import BodyParameters, FloatArray, IntArray
    from physic_scene.bundle import Bundle, BundleSettings, Observations
    from physic_scene.observations import PhotoPeople

__all__ = ["BodyFitSettings", "FittedBodies", "fit_bodies"]

_BODY = 22  # joints without hands and face


@dataclass(frozen=True)
class BodyFitSettings:
    """Expected sizes of the corrections of the mean body of all photos.

    Attributes:
        pose: of a joint's rotation, radians.
        shape: of a shape component.
        points_m: distance of a landmark from the point of the bundle, metres.
        steps: of L-BFGS.
    """

    pose: float = 0.2
    shape: float = 0.5
    points_m: float = 0.06
    steps: int = 40


@dataclass(frozen=True)
class FittedBodies:
    """Bodies of P people in the reference frame.

    Attributes:
        rotations: (P, 55, 3, 3) of each joint relative to its parent.
        betas: (P, K).
        transl: (P, 3) metres.
        landmarks: (P, J, 3) metres.
        joints: (P, 55, 3) metres.
    """

    rotations: Tensor
    betas: Tensor
    transl: Tensor
    landmarks: FloatArray
    joints: FloatArray

    def parameters(self, rows: Sequence[int], model: BodyModel) -> BodyParameters:
        """Return the parameters of some people."""
        index = torch.as_tensor(list(rows), dtype=torch.int64)
        expression = self.betas.new_zeros(len(index), model.num_expression)
        return parameters_from_rotations(self.rotations[index], self.betas[index], expression, self.transl[index])


def fit_bodies(
    people: Sequence[PhotoPeople],
    rows: IntArray,
    observations: Observations,
    bundle: Bundle,
    model: BodyModel,
    scales: tuple[BundleSettings, BodyFitSettings],
) -> FittedBodies:
    """Fit a body to each person by L-BFGS, from the mean pose and shape of the photos.

    Args:
        people: of each photo.
        rows: (P, V) row of each person in each photo, -1 where not shown.
        observations: of the same people.
        bundle: cameras and points.
        model: body model, float64.
        scales: expected sizes of the errors of keypoints, and of the corrections.
    """
    errors, settings = scales
    start, betas = _mean_bodies(people, rows, bundle)
    pose = model.landmarks_only([people[0].skeleton])
    points = torch.from_numpy(bundle.points)
    seen = torch.from_numpy(observations.confidence)
    with torch.no_grad():
        body = model(start, betas, betas.new_zeros(len(betas), 3))
        landmarks = model.landmarks(body, people[0].skeleton)
        weight = seen.amax(0)[..., None].clamp(min=1e-3)
        transl = ((points - landmarks) * weight).sum(1) / weight.sum(1)
    turns, shape, moves = (
        torch.zeros(len(betas), size, dtype=torch.float64, requires_grad=True)
        for size in (3 * _BODY, betas.shape[1], 3)
    )
    cameras = [torch.from_numpy(x) for x in (bundle.rotation, bundle.translation, _focal(observations.K, bundle))]
    unit = torch.from_numpy(errors.keypoint * observations.size_px)[..., None]

    def current() -> tuple[Tensor, Tensor, Tensor]:
        turn = rotvec_to_rotmat(turns.reshape(-1, _BODY, 3) * settings.pose)
        rotations = torch.cat([start[:, :_BODY] @ turn, start[:, _BODY:]], 1)
        return rotations, betas + settings.shape * shape, transl + 0.05 * moves

    def energy() -> Tensor:
        landmarks = pose(*current())[people[0].skeleton]
        local = torch.einsum("vij,pkj->vpki", cameras[0], landmarks) + cameras[1][:, None, None]
        pixels = torch.stack([project(x, K) for x, K in zip(local, cameras[2], strict=True)])
        away = (pixels - torch.from_numpy(observations.points)) / unit[..., None]
        total = (seen * robust_loss("cauchy", away.square().sum(-1), c=errors.outlier)).sum()
        off = ((landmarks - points) / settings.points_m).square().sum(-1)
        total = total + robust_loss("cauchy", off, c=errors.outlier).sum() * 0.2
        return total + turns.square().sum() + shape.square().sum()

    optimiser = torch.optim.LBFGS(
        [turns, shape, moves], max_iter=settings.steps, history_size=20, line_search_fn="strong_wolfe"
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        value = energy()
        value.backward()  # type: ignore[no-untyped-call]
        return value

    optimiser.step(closure)  # type: ignore[no-untyped-call]
    with torch.no_grad():
        rotations, final, place = current()
        body = model(rotations, final, place)
        return FittedBodies(
            rotations, final, place, model.landmarks(body, people[0].skeleton).numpy(), body.joints.numpy()
        )


def _mean_bodies(people: Sequence[PhotoPeople], rows: IntArray, bundle: Bundle) -> tuple[Tensor, Tensor]:
    """Return the robust mean of rotations (P, 55, 3, 3), reference frame, and the mean shape (P, K)."""
    rotations, betas = [], []
    for row in rows:
        views = np.flatnonzero(row >= 0).tolist()
        own = np.stack([people[v].rotations[row[v]] for v in views])
        own[:, 0] = np.einsum("vji,vjk->vik", bundle.rotation[views], own[:, 0])
        rotations.append(np.stack([mean_rotation(own[:, j], np.ones(len(views))) for j in range(own.shape[1])]))
        betas.append(np.mean([people[v].betas[row[v]] for v in views], axis=0))
    return torch.from_numpy(np.stack(rotations)), torch.from_numpy(np.stack(betas))


def _focal(K: FloatArray, bundle: Bundle) -> FloatArray:
    """Return the camera matrices (V, 3, 3) with the solved focal lengths."""
    solved = K.copy()
    solved[:, [0, 1], [0, 1]] *= np.exp(bundle.log_focal)[:, None]
    return solved
