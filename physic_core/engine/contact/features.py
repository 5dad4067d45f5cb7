"""Features of the probability of contact with skin and objects: one column per reason for or
against it.

A new feature is a new column here, and a coefficient in ``coefficients.json`` beside it. Distances
enter as logarithms, ``log(1 + d / 1 cm)``, for the outside and the inside of a surface.

All vertices of a body part share the errors of the part's position. Therefore the *gap* of a part
to a surface is one feature, and the *rise* of a vertex, its distance minus the gap, is another,
which is far more accurate. The gap is the fifth smallest distance of its vertices, which is robust
to outliers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import torch
from torch import Tensor

from physic_core.engine.contact.distance import (
    SEARCH_RADIUS_M,
    DistanceMeasure,
    SurfaceDistances,
    surface_distances,
)
from physic_core.engine.contact.problem import ContactInput
from physic_core.engine.contact.scene_parts import SceneParts, scene_parts
from physic_core.engine.contact.skin import (
    OWN_RADIUS_M,
    SkinDistances,
    own_distances,
    people_distances,
)
from physic_core.engine.limbs import hip_bends
from physic_core.geometry.mesh import vertex_normals
from physic_core.geometry.plane import height_over_plane

if TYPE_CHECKING:
    from physic_core.engine.contact.objects import ObjectDistances

KINDS = ("scene", "person", "own body", "object")
"""What a vertex may touch; floor and scene are one kind."""

Columns: TypeAlias = Mapping[str, Tensor]

_LOG_UNIT_M = 0.01
_STRAIGHT_HIP = np.pi / 4  # radians between thigh and trunk
_GAP_VERTICES = 5


@dataclass(frozen=True)
class Distances:
    """Distances of the vertices of N people to everything that they may touch, metres; inf beyond
    the search radius.

    Attributes:
        normals: (N, V, 3) unit, out of the bodies.
        surface: to scene and floor.
        parts: of the scene's points, which ``surface.point`` indexes.
        people: to the skin of other people.
        own: to the skin of other parts of the same body.
        objects: to small objects; None without them.
    """

    normals: Tensor
    surface: SurfaceDistances
    parts: SceneParts
    people: SkinDistances
    own: SkinDistances
    objects: ObjectDistances | None

    @property
    def by_kind(self) -> Tensor:
        """Signed distances (K, N, V), in the order of :data:`KINDS`."""
        far = torch.full_like(self.surface.scene, torch.inf)
        to_object = far if self.objects is None else self.objects.distance
        return torch.stack(
            [self.surface.nearest, self.people.distance, self.own.distance, to_object]
        )


def measure_distances(
    given: ContactInput, measure: DistanceMeasure, *, skin: bool = True
) -> Distances:
    """Measure the distances to scene, floor and small objects, and to ``skin`` of other people and
    the same body.
    """
    model = given.model
    vertices = given.vertices
    around = given.surfaces
    normals = vertex_normals(vertices, model.faces)
    surface = surface_distances(vertices, around, measure, given.free)
    height = None
    if given.plane is not None:
        height = height_over_plane(
            around.scene.points, given.up, vertices.new_tensor(given.plane[1])
        )
    parts = scene_parts(
        around.scene.points, around.scene.normals, around.row, given.classes, height, given.up
    )
    if skin:
        rest = model(*model.zero_pose()).vertices[0]
        people = people_distances(vertices, normals, model.outer, SEARCH_RADIUS_M)
        own = own_distances(
            vertices, normals, model.outer, model.part_of_vertex, rest, OWN_RADIUS_M
        )
    else:
        people = own = SkinDistances.none(vertices)
    objects = None
    if given.objects is not None:
        from physic_core.engine.contact.objects import object_distances

        objects = object_distances(vertices, given.objects, SEARCH_RADIUS_M)
    return Distances(normals, surface, parts, people, own, objects)


def feature_columns(given: ContactInput, near: Distances) -> dict[str, Columns]:
    """Return the columns (N, V) of the features of each kind of contact but the scene, by name."""
    part = given.model.part_of_vertex
    columns: dict[str, Columns] = {"own body": _own_columns(given, near.own)}
    if len(given.vertices) > 1:
        whose = part + len(given.model.part_names) * near.people.person
        columns["person"] = _skin_columns(given, near.people, whose)
    if near.objects is not None:
        columns["object"] = _shared_columns(
            near.objects.distance, part.expand_as(near.objects.object), given.seen
        )
    return columns


def part_gaps(distance: Tensor, group: Tensor) -> Tensor:
    """Return the gap (N, V) of the group of each vertex: the fifth smallest of its finite
    distances; inf without any.

    Args:
        distance: (N, V) signed, metres; inf where nothing is near.
        group: (N, V) int64; vertices of one person and group share their errors.
    """
    values = distance.detach().cpu().numpy()
    groups = group.cpu().numpy()
    gaps = np.full(values.shape, np.inf)
    for own, number, gap in zip(values, groups, gaps, strict=True):
        known = np.flatnonzero(np.isfinite(own))
        order = known[np.lexsort((own[known], number[known]))]
        _, first, inverse, count = np.unique(
            number[order], return_index=True, return_inverse=True, return_counts=True
        )
        gap[order] = own[order][first + np.minimum(count, _GAP_VERTICES) - 1][inverse]
    return torch.from_numpy(gaps).to(distance)


def _shared_columns(distance: Tensor, group: Tensor, seen: Tensor) -> dict[str, Tensor]:
    """Return the columns shared by all kinds, from distances (N, V) with groups (N, V) that share
    their errors.
    """
    near = torch.isfinite(distance)
    gap = part_gaps(distance, group)
    d, gap = (torch.where(torch.isfinite(x), x, SEARCH_RADIUS_M) for x in (distance, gap))
    return {
        "constant": torch.ones_like(d),
        "nothing near": (~near).to(d),
        "outside": _log_cm(d),
        "inside": _log_cm(-d),
        "rise": _log_cm(d - gap),
        "gap outside": _log_cm(gap),
        "unseen limb": (~seen).to(d),
    }


def _skin_columns(given: ContactInput, skin: SkinDistances, group: Tensor) -> dict[str, Tensor]:
    """Return the columns (N, V) of contact with other people."""
    hands = given.part("hand")
    other = given.model.part_of_vertex[skin.vertex]
    shared = _shared_columns(skin.distance, group * len(given.model.part_names) + other, given.seen)
    return shared | {"hand": (hands | hands[skin.vertex]).to(skin.distance)}


def _own_columns(given: ContactInput, skin: SkinDistances) -> dict[str, Tensor]:
    """Return the columns (N, V) of contact with the same body."""
    part = given.model.part_of_vertex
    hands = given.part("hand")
    thighs = given.part("upper_leg")
    arms = given.part("hand", "lower_arm")
    near = torch.isfinite(skin.distance)
    # One of two clasped hands usually hides the other: the place of a hand that the photo shows is
    # known.
    seen = given.seen | (given.seen & hands).gather(1, skin.vertex)
    shared = _shared_columns(
        skin.distance, part * len(given.model.part_names) + part[skin.vertex], seen
    )
    straight = hip_bends(given.joints) < _STRAIGHT_HIP
    hip = straight[:, given.part("right_upper_leg", "right_hand", "right_lower_arm").long()]
    at_thigh = (arms & thighs[skin.vertex]) | (thighs & arms[skin.vertex])
    hand = near & (hands | hands[skin.vertex])
    return shared | {
        "hand": hand.to(skin.distance),
        "outside, hand": hand * shared["outside"],
        "arm at straight hip": (near & at_thigh & hip).to(skin.distance),
    }


def _log_cm(distance: Tensor) -> Tensor:
    """Return log(1 + d / 1 cm) of the positive part of distances in metres."""
    return torch.log1p(torch.relu(distance) / _LOG_UNIT_M)
