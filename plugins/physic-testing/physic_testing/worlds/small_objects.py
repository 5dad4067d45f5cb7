"""Small objects that fit into the hands of a posed person: a ball between both palms, a cup in one hand.

The room's frame (x right, y up, z towards the camera's side), metres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from physic_core.body import JOINT_INDEX
from physic_testing.worlds.reproducible_math import norm
from physic_testing.worlds.skin_patches import contact_skin, vertex_normals
from physic_testing.worlds.solids import LEVEL_GROUND, Block, SolidDistances

if TYPE_CHECKING:
    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["ball_between_palms", "cup_in_hand"]

_CUP = (0.036, 0.052, 0.036)
_HALVINGS = 40


def ball_between_palms(model: BodyModel, vertices: FloatArray) -> Block:
    """Return the ball that touches both hands of a body with vertices (V, 3)."""
    skin = contact_skin(model)
    palms = [vertices[skin.patches[f"{side}_palm"]] for side in ("left", "right")]
    ends = [palm.sum(axis=0) / len(palm) for palm in palms]
    # The nearer it is to one end, the smaller the distance to that hand: halve the way until both are equal.
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        centre = ends[0] + middle * (ends[1] - ends[0])
        left, right = (float(norm(palm - centre).min()) for palm in palms)
        low, high = (low, middle) if left > right else (middle, high)
    radius = float(norm(vertices[skin.outer] - centre).min())
    x, y, z = centre.tolist()
    return Block((x, y, z), (radius, radius, radius), material="plaster", rounding=radius, item="ball")


def cup_in_hand(model: BodyModel, vertices: FloatArray, pose: FloatArray) -> Block:
    """Return an upright cup at the palm of the hand with the more bent fingers, of a body with vertices (V, 3)."""
    skin = contact_skin(model)
    normals = vertex_normals(vertices, skin.faces)
    side = max(("left", "right"), key=lambda name: float(norm(pose[JOINT_INDEX[f"{name}_index2"]])))
    palm = skin.patches[f"{side}_palm"]
    away = normals[palm].sum(axis=0)
    away[1] = 0.0
    away /= norm(away)
    start = vertices[palm].sum(axis=0) / len(palm)
    outer = vertices[skin.outer]
    near = outer[norm(outer - start) < 0.3]
    low, high = 0.0, 0.15
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        cup = _cup_at(start + middle * away)
        inside = SolidDistances((cup,), LEVEL_GROUND).distances(near)[0].min() < 0
        low, high = (middle, high) if inside else (low, middle)
    return _cup_at(start + high * away)


def _cup_at(centre: FloatArray) -> Block:
    x, y, z = centre.tolist()
    return Block((x, y, z), _CUP, material="plaster", rounding=0.030, item="cup")
