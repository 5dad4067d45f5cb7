"""Probability that each part of a body touches the world: floor, scene, or a support that the photo does not show.

Contact with the own body, other people and held objects does not count. No threshold applies: a part that the result
does not list as touching has a probability too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.contact.probability import mean_of_surest
from physic_core.engine.contact.regions import contact_regions
from physic_core.errors import PhysicError
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Person, Reconstruction

WORLD = ("floor", "scene", "hidden")
"""Kinds of :class:`physic_core.types.ContactPartner` that are the world."""

_KNEE_M = 0.08  # from the height of the knee in the rest pose; the kneecap is 5 cm high


def world_parts(model: BodyModel) -> dict[str, NDArray[np.int64]]:
    """Return the vertex ids of each part: both feet, hands, forearms and knees, "seat" and "back".

    Feet, hands, forearms and back are the body parts of :class:`physic_core.types.BodyContact`, where "left_forearm" is
    "left_lower_arm". "seat" is the buttocks and the backs of the thighs, "left_knee" the front of the leg at the joint.
    """
    regions = contact_regions(model)
    region, outer = regions.region.cpu().numpy(), model.outer.cpu().numpy()
    rest = model(*model.zero_pose())
    vertices, joints = rest.vertices[0].cpu().numpy(), rest.joints[0].cpu().numpy()
    parts = {}
    for side in SIDES:
        listed = {"foot": f"{side}_foot", "hand": f"{side}_hand", "forearm": f"{side}_lower_arm"}
        for name, own in listed.items():
            parts[f"{side}_{name}"] = np.flatnonzero(region == regions.names.index(own))
        legs = [regions.names.index(f"{side}_{name}") for name in ("upper_leg", "lower_leg")]
        away = vertices - joints[JOINT_INDEX[f"{side}_knee"]]
        front = outer & (np.abs(away[:, 1]) < _KNEE_M) & (away[:, 2] > 0)
        parts[f"{side}_knee"] = np.flatnonzero(np.isin(region, legs) & front)
    sets = {name: model.contact_sets[name].cpu().numpy() for name in ("gluteus", "thighs", "back")}
    return parts | {"seat": np.union1d(sets["gluteus"], sets["thighs"]), "back": sets["back"]}


def world_contact(result: Reconstruction, person: Person, model: BodyModel) -> dict[str, float]:
    """Return the probability in [0, 1] that each part of a person touches the world.

    It is the mean of the ten surest vertices of the part that touch nothing but the world, and no less than that of a
    listed contact of the part with the world.

    Args:
        result: contains the person.
        person: with probabilities of contact.
        model: body model of the result.

    Raises:
        PhysicError: the result has no probabilities, as of a preset that estimates none.
    """
    if person.contact_probability is None or person.contact_partner is None:
        raise PhysicError("this result has no probabilities of contact: its preset estimates none")
    other = [i for i, partner in enumerate(result.contact_partners) if partner.kind not in WORLD]
    likely = np.where(np.isin(person.contact_partner, other), 0.0, person.contact_probability)
    listed: dict[str, float] = {}
    for contact in person.contacts:
        if contact.partner.kind in WORLD:
            name = contact.part.replace("lower_arm", "forearm")
            listed[name] = max(contact.probability or 0.0, listed.get(name, 0.0))
    return {
        name: max(mean_of_surest(torch.from_numpy(likely[rows])), listed.get(name, 0.0))
        for name, rows in world_parts(model).items()
    }
