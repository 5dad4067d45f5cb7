"""What stage 4 does in each of its steps. An energy may replace some of them by a subclass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from physic_core.engine.contact.distance import ContactSurfaces, distance_along_normal, nearby_surfaces
from physic_core.engine.contact.features import KINDS, Distances, feature_columns
from physic_core.engine.contact.probability import ContactModel, contact_model
from physic_core.engine.contact.settings import ContactSettings
from physic_core.geometry.free_space import front_depth, in_free_space

if TYPE_CHECKING:
    from physic_core.engine.contact.problem import ContactInput
    from physic_core.engine.joint.problem import JointProblem

__all__ = ["ContactMethod", "Touch", "touch_by_probability"]


@dataclass(frozen=True)
class Touch:
    """What vertices touch.

    Attributes:
        kind: (N, V) int64, index into ``KINDS``; -1 without contact.
        probability: (N, V) of contact with anything; None if the method estimates none.
    """

    kind: Tensor
    probability: Tensor | None

    @staticmethod
    def of_rank(rank: Tensor, touches: Tensor, probability: Tensor | None) -> Touch:
        """Return the kind of contact with the highest rank (K, N, V) where a vertex ``touches`` (N, V) bool."""
        return Touch(torch.where(touches, rank.argmax(0), -1), probability)


class ContactMethod(ContactSettings):
    """Stage 4 of preset "default": what each vertex touches, and what carries each person."""

    def surfaces(self, problem: JointProblem, vertices: Tensor, scale: float) -> ContactSurfaces:
        """Return what bodies (B, V, 3), metres, may touch: the scaled scene near them, and the plane of the floor."""
        floor = None if problem.floor_normal is None else (problem.floor_normal, problem.floor_offset * scale)
        return nearby_surfaces(problem, vertices, scale, floor)

    def free_vertices(self, problem: JointProblem, vertices: Tensor, scale: float) -> Tensor | None:
        """Return the vertices (B, V) bool in space that the photo shows to be free; None if no depth is known."""
        if problem.scene_depth is None:
            return None
        return in_free_space(vertices / scale, front_depth(problem.scene_depth), problem.K)

    def measure(self, offsets: Tensor, normals: Tensor, distance: Tensor) -> Tensor:
        """Return the distance of vertices to the scene; arguments as in ``DistanceMeasure``."""
        return distance_along_normal(offsets, normals, distance)

    def touch(self, given: ContactInput, near: Distances) -> Touch:
        """Return the contacts by the fitted probability."""
        return touch_by_probability(given, near, contact_model(), self)


def touch_by_probability(given: ContactInput, near: Distances, model: ContactModel, settings: ContactSettings) -> Touch:
    """Return the contacts of vertices whose probability is at least the threshold of the settings."""
    probabilities = model.probabilities(feature_columns(given, near))
    in_reach = torch.isfinite(near.by_kind)
    may_touch = given.model.outer & given.finite[:, None]
    likely = torch.where(may_touch, 1 - (1 - probabilities).prod(0), 0.0)
    rank = torch.where(in_reach, probabilities, -1.0)
    skin = torch.where(in_reach, probabilities, 0.0)[1 : KINDS.index("object")].amax(0)
    on_skin = (skin >= settings.skin_threshold) & (rank.argmax(0) > 0)
    touches = ((likely >= settings.threshold) & in_reach.any(0)) | on_skin
    return Touch.of_rank(rank, touches & may_touch, likely)
