"""Evidence of photo and posture for contact of body parts with the scene, in addition to distances.

Distances do not show whether the foot of a runner or the seat of a person on a bench touches: the body is off by
centimetres, and depth networks miss benches. Each part therefore has its own log odds: those of its ten most probable
vertices, and the evidence of image and posture. The vertices of the part are shifted by the difference, so that part
and vertices agree. Offsets and slopes are in ``parts.json``, with the labelled photos that they were fitted on and
their error on held-out photos. They are written by ``benchmarks/contact_on_photos.py``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files

import torch
from torch import Tensor

from physic_core.body.joints import joint_pair
from physic_core.body.model import BodyModel
from physic_core.engine.contact.probability import SUREST_VERTICES
from physic_core.engine.contact.problem import ContactInput
from physic_core.engine.contact.regions import contact_regions
from physic_core.types.skeletons import SIDES

SEAT = "seat"
"""Part of buttocks and thighs: what people sit on."""

LEAST_PROBABILITY = 0.5
"""Minimum probability of a part in contact: others are not listed and do not support the person."""

LOG_ODDS, LOG_ODDS_ABOVE_EVEN = "log odds", "log odds above even"

_KIND_OF = {"foot": "foot", "hand": "hand", "seat": SEAT, "upper_leg": SEAT, "back": "back"}  # others are limbs
_ODDS = 1e-4  # least distance of a probability from 0 and 1
_MAX_LIFTED = 4.0  # standard deviations; more of them say no more
_HIPS, _KNEES, _ANKLES = joint_pair("hip"), joint_pair("knee"), joint_pair("ankle")
_SHOULDERS, _WRISTS = joint_pair("shoulder"), joint_pair("wrist")


def scene_parts_of_body(model: BodyModel) -> dict[str, Tensor]:
    """Return the vertices (V,) bool of each part: the regions of contacts, with both thighs and the buttocks as one."""
    regions = contact_regions(model)
    found: dict[str, Tensor] = {}
    for number, name in enumerate(regions.names):
        part = SEAT if kind_of_part(name) == SEAT else name
        chosen = (regions.region == number) & model.outer
        found[part] = found[part] | chosen if part in found else chosen
    return found


def weigh_parts(given: ContactInput, probability: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the probabilities (N, V) of contact with the scene from the evidence of each part, and those of the parts.

    Args:
        given: bodies, and their evidence in the photo.
        probability: (N, V) by the distances.

    Returns:
        The probabilities of the vertices, and part -> (N,).
    """
    moved, parts, vertices = probability.clone(), {}, scene_parts_of_body(given.model)
    for name, features in part_features(given, probability).items():
        weights, chosen = _weights()[kind_of_part(name)], vertices[name]
        odds = torch.full_like(features[LOG_ODDS], weights["constant"])
        for key in sorted(weights.keys() - {"constant"}):
            odds = odds + weights[key] * features[key]
        parts[name] = torch.sigmoid(odds)
        change = odds - features[LOG_ODDS]
        moved[:, chosen] = torch.sigmoid(torch.logit(probability[:, chosen], _ODDS) + change[:, None])
    return moved, parts


def part_features(given: ContactInput, probability: Tensor) -> dict[str, dict[str, Tensor]]:
    """Return part -> name of a feature -> values (N,): one reason for or against contact of the part with the scene.

    "log odds" are those of the mean probability of the ten most probable vertices by distance; the same "above even" is
    0 where distances contradict contact: a seat missing from the depth is far away. "picture": log odds that the foot
    touches something by its keypoints. "lifted": standard deviations that the feet are from standing on the floor.
    "lifted, hand up": the same times the height of the hand above the shoulder, in leg lengths; "hands" is the
    mean of both. "thighs": their mean elevation, radians; 0 is horizontal.

    Args:
        given: bodies, and what the photo shows of them.
        probability: (N, V) by the distances.
    """
    joints = given.joints
    lifted = torch.zeros_like(joints[:, 0, 0])
    if given.standing is not None:
        lifted = torch.relu(-torch.nan_to_num(given.standing.to(lifted))).clamp(max=_MAX_LIFTED)
    picture = torch.zeros_like(joints[:, :2, 0])
    if given.foot_touch is not None:
        picture = torch.logit(given.foot_touch.to(picture), _ODDS)
    thighs = joints[:, _KNEES] - joints[:, _HIPS]
    length = torch.linalg.vector_norm(thighs, dim=-1)
    level = torch.asin(((thighs @ given.up) / length).clamp(-1, 1)).mean(1)
    shins = torch.linalg.vector_norm(joints[:, _ANKLES] - joints[:, _KNEES], dim=-1)
    raised = torch.relu((joints[:, _WRISTS] - joints[:, _SHOULDERS]) @ given.up) / (length + shins).mean(
        1, keepdim=True
    )
    found = {}
    for name, chosen in scene_parts_of_body(given.model).items():
        odds = torch.logit(probability[:, chosen].topk(SUREST_VERTICES).values.mean(1), _ODDS)
        found[name] = {LOG_ODDS: odds}
        side = SIDES.index(name.partition("_")[0]) if name.startswith(SIDES) else 0
        match kind_of_part(name):
            case "foot":
                hands = lifted * raised.nan_to_num().mean(1)
                found[name] |= {"picture": picture[:, side], "lifted": lifted, "lifted, hands up": hands}
            case "hand":
                found[name] |= {"lifted": lifted, "lifted, hand up": lifted * raised[:, side].nan_to_num()}
            case "seat":
                found[name] |= {LOG_ODDS_ABOVE_EVEN: torch.relu(odds), "thighs": level.nan_to_num()}
    return found


def kind_of_part(part: str) -> str:
    """Return the kind of a part: "foot", "hand", "seat", "back" or "limb"; parts of one kind have one model."""
    return _KIND_OF.get(part.removeprefix("left_").removeprefix("right_"), "limb")


@cache
def _weights() -> Mapping[str, Mapping[str, float]]:
    """Return kind of part -> name of a feature -> coefficient."""
    text = (files("physic_core.engine.contact") / "parts.json").read_text(encoding="utf-8")
    weights: Mapping[str, Mapping[str, float]] = json.loads(text)["parts"]
    return weights
