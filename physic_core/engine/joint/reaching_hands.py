"""Hands that the photo shows on another person, while the bodies are apart in depth. Camera frame, metres.

The pixels of a hand and of the person behind it are known to about two centimetres, the depth of one person relative to
another only to one or two decimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ["Hand", "Reach", "ReachingPairs", "find_reaches", "meeting_pairs"]

_BESIDE_M = 0.03  # across the rays: the error of a hand's pixels, and the spacing of the vertices
_FIRST_M = 0.02  # of depth after the first pair that would meet


@dataclass(frozen=True)
class Hand:
    """One hand of a person.

    Attributes:
        person: its owner.
        rows: (h,) int64, its rows of the subsampled vertices.
        others: (k,) int64, rows of the body without this hand and its lower arm.
        hands: (m,) int64, rows of both hands.
    """

    person: int
    rows: Tensor
    others: Tensor
    hands: Tensor


@dataclass(frozen=True)
class Reach:
    """A hand and another person whom it would meet if the two moved along the rays."""

    hand: Hand
    other: int


@dataclass(frozen=True)
class ReachingPairs:
    """p pairs of a vertex of a hand and a vertex of another person at about the same pixel.

    Attributes:
        person: (p,) int64, owner of the hand.
        row: (p,) int64, row of the subsampled vertices.
        other: (p,) int64, the other person.
        other_row: (p,) int64, row of the subsampled vertices.
        share: (p,) of the pairs of one hand and one person; they sum to 1.
    """

    person: Tensor
    row: Tensor
    other: Tensor
    other_row: Tensor
    share: Tensor

    def __len__(self) -> int:
        return len(self.person)


@torch.no_grad()
def find_reaches(hands: Sequence[Hand], vertices: Tensor, near: float, reach: float) -> list[Reach]:
    """Find the hands that are before or behind another person, apart from that person by at most ``reach`` of depth.

    Two people who touch each other anywhere are at the right depths. A hand that rests on the own body may be before a
    neighbour by chance, unless it is a hand of the neighbour.

    Args:
        hands: visible ones.
        vertices: (B, n, 3) subsampled vertices, metres, in front of the camera.
        near: surfaces nearer than this touch each other, metres.
        reach: metres.
    """
    found = []
    for hand in hands:
        own = vertices[hand.person]
        resting = bool((torch.cdist(own[hand.rows], own[hand.others]) < near).any())
        for other in range(len(vertices)):
            if other == hand.person:
                continue
            rows, apart = _apart_in_depth(Reach(hand, other), vertices)
            if resting and len(rows):
                apart = apart[:, torch.isin(rows, hand.hands)]
            if not bool((apart < reach).any()):
                continue
            if not bool((torch.cdist(own, vertices[other]) < near).any()):
                found.append(Reach(hand, other))
    return found


@torch.no_grad()
def meeting_pairs(reaches: Sequence[Reach], vertices: Tensor) -> ReachingPairs:
    """Return the vertices (B, n, 3) of each hand and the other person that meet first along the rays."""
    none = torch.zeros(0, dtype=torch.int64, device=vertices.device)
    parts = [(none, none, none, none, vertices.new_zeros(0))]
    for one in reaches:
        rows, apart = _apart_in_depth(one, vertices)
        if not bool(torch.isfinite(apart).any()):
            continue
        first, second = (apart < apart.amin() + _FIRST_M).nonzero(as_tuple=True)
        same = torch.ones_like(first)
        share = vertices.new_full((len(first),), 1 / len(first))
        parts.append((same * one.hand.person, one.hand.rows[first], same * one.other, rows[second], share))
    return ReachingPairs(*(torch.cat(columns) for columns in zip(*parts, strict=True)))


def _apart_in_depth(one: Reach, vertices: Tensor) -> tuple[Tensor, Tensor]:
    """Return the rows (k,) of the other person around the hand, and the differences of depth (h, k) to the hand.

    A difference is inf where the two vertices are not at about the same pixel.
    """
    points, body = vertices[one.hand.person, one.hand.rows], vertices[one.other]
    depth = points[:, 2].mean()
    flat, others = points[:, :2] / points[:, 2:] * depth, body[:, :2] / body[:, 2:] * depth
    rows = ((others > flat.amin(0) - _BESIDE_M) & (others < flat.amax(0) + _BESIDE_M)).all(1)
    rows = rows.nonzero(as_tuple=True)[0]
    beside = torch.cdist(flat, others[rows])
    return rows, torch.where(beside < _BESIDE_M, (body[rows, 2] - points[:, 2:]).abs(), torch.inf)
