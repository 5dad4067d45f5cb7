"""Join term: a hand touches another hand or a knee.

A photo shows neither gap nor contact of two limbs along a ray. If their keypoints meet, stage 3 is minimised with and
without contact: :mod:`physic_core.engine.joint.hypotheses`. Camera frame, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import torch
from torch import Tensor

from physic_core.engine.joint.context import JointContext
from physic_core.engine.joint.term import PosedBodies, Snapshot, Term
from physic_core.geometry.robust import pseudo_huber
from physic_core.types.bounds import NotNegative, Positive
from physic_core.types.skeletons import SIDES, is_finger

_OUTLIER_SIGMAS = 2.0  # beyond, the pull is constant
_PARTS = {"hand": ("hand",), "knee": ("upper_leg", "lower_leg")}


@dataclass(frozen=True)
class JoinSettings:
    """Settings of joins: a hand that touches another hand, or a knee of the same person."""

    weight: NotNegative = 4.0
    """Weight of a join, which closes gaps to a centimetre; 0 disables joins."""
    width_m: Positive = 0.1
    """Largest distance in the image between a keypoint of the hand and one of the other limb, metres at their depth:
    the width of a hand."""
    reach_m: Positive = 0.25
    """Largest gap without the join, metres. Hands that met in photos at larger gaps (0.31-1.13) did not touch."""
    sigma_m: Positive = 0.02
    """Expected distance of touching vertices, metres: their spacing. Nearer limbs need no join, and a join that leaves
    twice this distance is rejected."""
    max_rise: NotNegative = 4.0
    """Largest energy that a join may add to the other terms of its people, each at weight 1. In photos: at most 3
    for hands that touch another hand, at least 4.7 for hands that do not."""


@dataclass(frozen=True)
class Join:
    """A hand and the limb that it may touch.

    Attributes:
        person: owner of the hand.
        rows: (m,) int64, the hand's rows of the subsampled vertices.
        other: owner of the other limb.
        other_rows: (k,) int64, rows of the other limb.
    """

    person: int
    rows: Tensor
    other: int
    other_rows: Tensor

    def nearest(self, vertices: Tensor) -> tuple[float, int, int]:
        """Return the smallest distance between both limbs, metres, and its two rows of the vertices (B, n, 3)."""
        distance = torch.cdist(vertices[self.person, self.rows], vertices[self.other, self.other_rows])
        row, column = divmod(int(distance.argmin()), len(self.other_rows))
        return float(distance[row, column]), int(self.rows[row]), int(self.other_rows[column])

    def among(self, people: Sequence[int]) -> Join:
        """Return the join in a problem with only some of the people."""
        return replace(self, person=people.index(self.person), other=people.index(self.other))


@torch.no_grad()
def find_joins(settings: JoinSettings, context: JointContext, vertices: Tensor) -> list[Join]:
    """Find limbs that meet in the image, and are apart but within reach along the ray; the nearest in the image first.

    Args:
        settings: of joins.
        context: constants of the optimisation.
        vertices: (B, n, 3) subsampled vertices, metres.
    """
    found: list[tuple[float, Join]] = []
    limbs = [(p, kind, side) for kind in _PARTS for p in range(len(vertices)) for side in SIDES]
    points = {limb: _keypoints(context, *limb) for limb in limbs}
    shown = [limb for limb in limbs if len(points[limb])]
    for hand, limb in combinations(shown, 2):
        if hand[1] == "knee" or (limb[1] == "knee" and limb[0] != hand[0]):
            continue
        join = Join(hand[0], _rows(context, *hand[1:]), limb[0], _rows(context, *limb[1:]))
        gap, row, _ = join.nearest(vertices)
        m_per_px = float(vertices[join.person, row, 2] / context.problem.K[1, 1])
        beside = m_per_px * float(torch.cdist(points[hand], points[limb]).amin())
        if beside <= settings.width_m and settings.sigma_m < gap <= settings.reach_m:
            found.append((beside, join))
    return [join for _, join in sorted(found, key=lambda each: each[0])]


def _keypoints(context: JointContext, person: int, kind: str, side: str) -> Tensor:
    """Return the confident keypoints (k, 2) px of a limb: the knee, or the wrist and the fingers."""
    names = context.problem.skeleton.names
    own = {f"{side}_knee"} if kind == "knee" else {f"{side}_wrist", *(n for n in names if is_finger(n))}
    chosen = [j for j, name in enumerate(names) if name in own and name.startswith(side)]
    return context.keypoints.points[person, chosen][context.keypoints.confident[person, chosen]]


def _rows(context: JointContext, kind: str, side: str) -> Tensor:
    """Return the rows of the subsampled vertices on a hand, or on the leg around a knee."""
    model = context.problem.model
    parts = [model.part_names.index(f"{side}_{name}") for name in _PARTS[kind]]
    part = model.part_of_vertex[context.ids]
    return torch.isin(part, part.new_tensor(parts)).nonzero(as_tuple=True)[0]


class JoinTerm(Term):
    """Join term: ``weight rho(d^2 / sigma^2)`` of each join, with the distance d of its two nearest vertices.

    The vertices are found at each refresh, and kept until the next one.

    Attributes:
        joins: the assumed ones.
    """

    def __init__(self, settings: JoinSettings, joins: tuple[Join, ...] = ()) -> None:
        self.settings, self.joins = settings, joins
        self._pairs: list[tuple[int, int]] = []

    @property
    def links(self) -> Tensor:
        """Pairs (k, 2) int64 of people who are joined."""
        return torch.tensor([(join.person, join.other) for join in self.joins]).reshape(-1, 2)

    def refresh(self, snapshot: Snapshot) -> None:
        """Find the nearest vertices of each join."""
        self._pairs = [join.nearest(snapshot.vertices)[1:] for join in self.joins]

    def __call__(self, bodies: PosedBodies) -> dict[str, Tensor]:
        """Return the energy "joins", of the owners of the hands."""
        energy = torch.zeros_like(bodies.vertices[:, 0, 0])
        for join, (row, other_row) in zip(self.joins, self._pairs, strict=True):
            gap = bodies.vertices[join.person, row] - bodies.vertices[join.other, other_row]
            loss = pseudo_huber(gap.square().sum() / self.settings.sigma_m**2, _OUTLIER_SIGMAS)
            energy = energy.index_add(0, self.links.new_tensor([join.person]), self.settings.weight * loss[None])
        return {"joins": energy}
