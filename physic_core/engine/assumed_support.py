"""Contact with supports that the scene lacks: a seat that the person hides, or something thin that a hand holds.

The point map has front surfaces only, and people hide what they sit on. Camera frame, metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from physic_core.body.joints import SIDES, joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.joint.limbs import is_sitting

__all__ = ["PosedPerson", "assumed_hold", "assumed_seat", "hands_may_hold", "is_over_feet"]

_ANKLES, _TOES = joint_pair("ankle"), joint_pair("foot")
_SEAT_PARTS = ("thighs", "gluteus")
_FEET = ("left_sole", "right_sole")
_MIN_HOLD_PROBABILITY = 0.75  # of the contact prior, mean of a hand that holds something
_MIN_SHARE = 0.02  # of the vertices of thighs and buttocks in contact with a seat
_PATCH_M = 0.04  # thickness of the layer above the lowest vertices that rests on an assumed seat; cushions give way
_LOWEST_SHARE = 0.02
_DOWNWARD = -0.3  # cosine between a normal and up: supporting vertices face down
_STANDING_POINT = 0.35  # position of the centre of mass between ankles (0) and balls of the feet (1)
_BALANCE_M = 0.2  # metres, within which the centre of mass is over the feet; poses are off by a decimetre along the ray


@dataclass(frozen=True)
class PosedPerson:
    """Posed body of one person.

    Attributes:
        vertices: (V, 3) metres.
        normals: (V, 3) unit, out of the body.
        joints: (55, 3) metres.
        rotations: (55, 3, 3).
    """

    vertices: Tensor
    normals: Tensor
    joints: Tensor
    rotations: Tensor


def assumed_seat(model: BodyModel, body: PosedPerson, contact: Tensor, may_touch: Tensor, up: Tensor) -> Tensor:
    """Return the contacts of one person with a seat that the scene lacks: (V,) bool, all False if none is needed.

    A seat is assumed for a person who sits (:func:`physic_core.engine.joint.limbs.is_sitting`), without contact of
    thighs and buttocks, and whose centre is not over feet in contact. It is a level patch at the height of the lowest
    vertices of thighs and buttocks.

    Args:
        body: of the person.
        contact: (V,) bool, with scene and floor.
        may_touch: (V,) bool, vertices that may be in contact.
        up: (3,) unit.
    """
    none = torch.zeros_like(contact)
    seat = none.clone()
    for name in _SEAT_PARTS:
        seat[model.contact_sets[name]] = True
    seat &= may_touch
    if not bool(seat.any()) or not bool(is_sitting(body.rotations[None], body.joints[None], up)[0]):
        return none
    touches = float(contact[seat].float().mean()) >= _MIN_SHARE
    stands = any(bool(contact[model.contact_sets[name]].any()) for name in _FEET) and is_over_feet(
        body.vertices, body.joints, up
    )
    if touches or stands:
        return none
    height = body.vertices @ up
    bottom = height[seat].kthvalue(max(1, round(_LOWEST_SHARE * int(seat.sum())))).values
    return seat & (body.normals @ up < _DOWNWARD) & (height < bottom + _PATCH_M)


def assumed_hold(model: BodyModel, contact: Tensor, probability: Tensor, lifted_feet: Tensor) -> Tensor:
    """Return the contacts of the hands of one person with something that the scene lacks: (V,) bool.

    If both feet are in the air and the person is on no seat, hands with a probable contact carry the person: point
    maps lack bars and rails, which are a few pixels wide.

    Args:
        contact: (V,) bool, with scene and floor.
        probability: (V,) of the contact prior.
        lifted_feet: (2,) bool, left and right foot in the air.
    """
    held = torch.zeros_like(contact)
    seat = torch.cat([model.contact_sets[name] for name in _SEAT_PARTS])
    if not bool(lifted_feet.all()) or float(contact[seat].float().mean()) >= _MIN_SHARE:
        return held
    for k, side in enumerate(SIDES):
        if bool(_hands_that_may_hold(model, probability[None])[0, k]):
            held[model.contact_sets[f"{side}_hand"]] = True
    return held


def hands_may_hold(model: BodyModel, probability: Tensor) -> Tensor:
    """Return which people may hold something with a hand, by the contact prior: (B, V) -> (B,) bool."""
    return _hands_that_may_hold(model, probability).any(1)


def _hands_that_may_hold(model: BodyModel, probability: Tensor) -> Tensor:
    """Return which hands may hold something, left and right: (B, V) -> (B, 2) bool."""
    means = [probability[:, model.contact_sets[f"{side}_hand"]].mean(1) for side in SIDES]
    return torch.stack(means, 1) >= _MIN_HOLD_PROBABILITY


def is_over_feet(vertices: Tensor, joints: Tensor, up: Tensor) -> bool:
    """Return whether the centre of a body (V, 3) is over its feet, within 20 cm along the floor.

    The distance is measured to the line between the points of both feet that carry a person in quiet standing.

    Args:
        vertices: (V, 3) metres.
        joints: (55, 3) metres.
        up: (3,) unit.
    """
    ankles, toes = joints[_ANKLES], joints[_TOES]
    feet = ankles + _STANDING_POINT * (toes - ankles)
    feet, centre = (x - (x @ up)[..., None] * up for x in (feet, vertices.mean(0)))
    line = feet[1] - feet[0]
    share = ((centre - feet[0]) @ line / line.square().sum().clamp(min=1e-9)).clamp(0.0, 1.0)
    return bool((centre - feet[0] - share * line).norm() < _BALANCE_M)
