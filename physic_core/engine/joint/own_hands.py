"""Visible hands at the own body, and the vertices where the two meet. Camera frame, metres.

The depth of a hand relative to the own body is known to about five centimetres, its pixels to two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
import torch.nn.functional as F
from torch import Tensor

from physic_core.body.joints import SIDES, joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.joint.limbs import straight_hips
from physic_core.engine.joint.people_pairs import PeoplePairs

__all__ = ["OwnHand", "find_own_pairs", "hands_of", "hanging_hands"]

_STRAIGHT_ELBOW_COSINE = 0.5  # 60 degrees
_REACH_M = 0.08  # of the search
_MAX_BESIDE_M = 0.02  # of a vertex from the normal of its partner: the spacing of the partners
_MAX_SLANT = 0.5  # the same, as a share of the distance along the normal
_MAX_GAP_M = 0.05  # of hands that touch: on worlds 24 of 25, unless they hang or are at the thigh
_MAX_THIGH_GAP_M = 0.015  # of hands that touch the thigh of their side, over which they are held in many poses
_FLAT_M = 0.03  # skin of a hand this much farther than its nearest skin touches, too
_FIRST = 3  # vertices; the nearest skin is that of the third, so that single ones do not decide
_NEARLY_INSIDE_M = 0.02  # other vertices are not expected to come inside before the next refresh


@dataclass(frozen=True)
class OwnHand:
    """One visible hand of a person, and the skin of the own body that it may meet.

    Attributes:
        person: its owner.
        touches: whether it may be pulled; else it is only kept out of the body.
        probes: (h,) int64, index of each probe of the hand.
        rows: (h,) int64, its row of the subsampled vertices.
        skin: (k,) int64, rows of the body without this arm.
        on_thigh: (k,) bool, skin of the thigh of the same side.
        thigh_gap_m: largest distance at which the hand touches that thigh; negative if it does not touch it.
    """

    person: int
    touches: bool
    probes: Tensor
    rows: Tensor
    skin: Tensor
    on_thigh: Tensor
    thigh_gap_m: float = _MAX_THIGH_GAP_M


def hanging_hands(joints: Tensor) -> Tensor:
    """Return which hands (B, 2) bool, left and right, hang: elbow and hip of their side are nearly straight.

    They are near the thigh and rarely touch it. Who sits or bends forward rests the hands on the thighs.

    Args:
        joints: (B, 55, 3) metres.
    """
    upper, lower = (
        F.normalize(joints[:, joint_pair(end)] - joints[:, joint_pair(start)], dim=-1)
        for start, end in (("shoulder", "elbow"), ("elbow", "wrist"))
    )
    return ((upper * lower).sum(-1) > _STRAIGHT_ELBOW_COSINE) & straight_hips(joints)


def hands_of(model: BodyModel, ids: Tensor, probes: Tensor, seen: Tensor, joints: Tensor) -> list[OwnHand]:
    """Return the visible hands of all people. They do not touch the thigh of a straight hip.

    Args:
        model: body model.
        ids: (n,) int64, the subsampled vertices.
        probes: (m,) int64, rows of these that are compared with skin.
        seen: (B, n) bool, vertices of limbs that the photo shows.
        joints: (B, 55, 3) metres.
    """
    hanging, straight = hanging_hands(joints), straight_hips(joints)
    part, names = model.part_of_vertex[ids], model.part_names
    found = []
    for column, side in enumerate(SIDES):
        hand, *arm = (names.index(f"{side}_{name}") for name in ("hand", "lower_arm", "upper_arm"))
        own = (part[probes] == hand).nonzero(as_tuple=True)[0]
        skin = (~torch.isin(part, part.new_tensor([hand, *arm]))).nonzero(as_tuple=True)[0]
        on_thigh = part[skin] == names.index(f"{side}_upper_leg")
        for person in seen[:, probes[own]].any(1).nonzero(as_tuple=True)[0].tolist():
            touches = not bool(hanging[person, column])
            thigh_gap = -1.0 if bool(straight[person, column]) else _MAX_THIGH_GAP_M
            found.append(OwnHand(person, touches, own, probes[own], skin, on_thigh, thigh_gap))
    return found


@torch.no_grad()
def find_own_pairs(hands: Sequence[OwnHand], vertices: Tensor, normals: Tensor) -> tuple[PeoplePairs, Tensor] | None:
    """Find the nearest skin of the own body that faces each vertex of the hands, and the pairs (p,) bool that touch.

    Returns None if no hand is near the own body. The two people of a pair are one.

    Args:
        hands: visible ones.
        vertices: (B, n, 3) subsampled vertices, metres.
        normals: (B, n, 3) unit, out of the bodies.
    """
    found = [near for hand in hands if (near := _pairs_of(hand, vertices, normals)) is not None]
    if not found:
        return None
    pairs = (torch.cat([getattr(one, f.name) for one, _ in found]) for f in fields(PeoplePairs))
    return PeoplePairs(*pairs), torch.cat([touching for _, touching in found])


def _pairs_of(hand: OwnHand, vertices: Tensor, normals: Tensor) -> tuple[PeoplePairs, Tensor] | None:
    """Return the pairs of one hand, and which of them touch; None if there are none."""
    body, outward = vertices[hand.person], normals[hand.person]
    apart = torch.cdist(body[hand.rows], body[hand.skin])
    facing = outward[hand.rows] @ outward[hand.skin].T < 0
    nearest, column = torch.where(facing, apart, torch.inf).min(1)
    other = hand.skin[column]
    offset = body[hand.rows] - body[other]
    along = (offset * outward[other]).sum(-1)
    beside = (offset - along[:, None] * outward[other]).norm(dim=-1)
    near = (nearest < _REACH_M) & (beside < (_MAX_SLANT * along.abs()).clamp(min=_MAX_BESIDE_M))
    if not bool(near.any()):
        return None
    order = torch.where(near, along, torch.inf).argsort()
    third = order[min(_FIRST, int(near.sum())) - 1]
    gap = along[third].clamp(min=0)
    widest = hand.thigh_gap_m if bool(hand.on_thigh[column[third]]) else _MAX_GAP_M
    touching = near & (along < (gap + _FLAT_M).clamp(max=_MAX_GAP_M))
    touching &= hand.touches and bool(gap < widest)
    kept = (near & (touching | (along < _NEARLY_INSIDE_M))).nonzero(as_tuple=True)[0]
    person = torch.full_like(kept, hand.person)
    pairs = PeoplePairs(
        person, hand.rows[kept], hand.probes[kept], person, other[kept], outward[other[kept]], along[kept]
    )
    return (pairs, touching[kept]) if len(kept) else None
