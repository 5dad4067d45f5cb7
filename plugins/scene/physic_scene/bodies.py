"""One body for each person from several photos: their mean pose and shape, at the place of the
person's points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.body import parameters_from_rotations
from physic_core.engine.sizes.stature import betas_with_stature
from physic_scene.rigid import mean_rotation

if TYPE_CHECKING:
    from torch import Tensor

    from physic_core.body import BodyModel
    from physic_core.types import BodyParameters, FloatArray, IntArray
    from physic_scene.bundle import Bundle, MomentObservations
    from physic_scene.observations import PhotoPeople


@dataclass(frozen=True)
class MeanBodies:
    """Bodies of P people in the reference frame.

    Attributes:
        rotations: (P, 55, 3, 3) of each joint relative to its parent.
        betas: (P, K).
        transl: (P, 3) metres.
        joints: (P, 55, 3) metres.
    """

    rotations: Tensor
    betas: Tensor
    transl: Tensor
    joints: FloatArray

    def parameters(self, rows: Sequence[int], model: BodyModel) -> BodyParameters:
        """Return the parameters of some people."""
        index = torch.as_tensor(list(rows), dtype=torch.int64)
        expression = self.betas.new_zeros(len(index), model.num_expression)
        return parameters_from_rotations(
            self.rotations[index], self.betas[index], expression, self.transl[index]
        )


def mean_bodies(
    people: Sequence[PhotoPeople],
    rows: IntArray,
    observations: MomentObservations,
    bundle: Bundle,
    model: BodyModel,
    statures: FloatArray,
) -> MeanBodies:
    """Return the mean body of each person, moved onto the points of the bundle.

    Args:
        people: of each photo.
        rows: (P, V) row of each person in each photo, -1 where not shown.
        observations: of the same people.
        bundle: cameras and points.
        model: body model, float64.
        statures: (P,) metres, of the bodies; NaN for those of the mean bodies.
    """
    rotations, betas = _mean_pose_and_shape(people, rows, bundle)
    betas = betas_with_stature(model, betas, torch.from_numpy(statures))
    weight = torch.from_numpy(observations.confidence).amax(0)[..., None].clamp(min=1e-3)
    with torch.inference_mode():
        body = model(rotations, betas, betas.new_zeros(len(betas), 3))
        away = torch.from_numpy(bundle.points) - model.landmarks(body, people[0].skeleton)
        transl = (away * weight).sum(1) / weight.sum(1)
        return MeanBodies(rotations, betas, transl.clone(), (body.joints + transl[:, None]).numpy())


def _mean_pose_and_shape(
    people: Sequence[PhotoPeople], rows: IntArray, bundle: Bundle
) -> tuple[Tensor, Tensor]:
    """Return the robust mean of rotations (P, 55, 3, 3), reference frame, and the mean shape (P,
    K).
    """
    rotations = []
    betas = []
    for row in rows:
        views = np.flatnonzero(row >= 0).tolist()
        own = np.stack([people[v].rotations[row[v]] for v in views])
        own[:, 0] = np.einsum("vji,vjk->vik", bundle.rotation[views], own[:, 0])
        rotations.append(np.stack([mean_rotation(own[:, j]) for j in range(own.shape[1])]))
        betas.append(np.mean([people[v].betas[row[v]] for v in views], axis=0))
    return torch.from_numpy(np.stack(rotations)), torch.from_numpy(np.stack(betas))
