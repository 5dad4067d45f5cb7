"""Contact of body parts and of their vertices with scene and floor.

A part has one probability, see :mod:`physic_core.engine.touch`. All its vertices share the errors
of its position, so that its distance is one number: the fifth smallest of its vertices, which is
robust to outliers. A vertex has the probability of its part, times how near it is to the surface
beside the nearest vertices of the part, and how directly its skin faces the surface.

The place of a part that no pixel shows is a guess, so its distance is ignored. It has the base rate
of its kind, and feet that of the posture.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from physic_core.body.model import BodyModel
from physic_core.engine.contact.distance import SEARCH_RADIUS_M
from physic_core.engine.contact.features import Distances
from physic_core.engine.contact.probability import contact_model
from physic_core.engine.contact.problem import ContactInput
from physic_core.engine.contact.regions import contact_regions
from physic_core.engine.limbs import hip_bends
from physic_core.engine.stance import Stance
from physic_core.engine.touch import DEPTH_BESIDE, DISTANCE, HANGING, HOLDING, touch_log_odds
from physic_core.types.skeletons import SIDES

SEAT = "seat"
"""Part of buttocks and thighs: what people sit on."""

_KIND_OF = {"foot": "foot", "hand": "hand", "seat": SEAT, "upper_leg": SEAT}
_RATED = ("foot", "hand", SEAT)  # kinds whose rate is known where no pixel shows them
_GAP_VERTICES = 5
_SIGMA_M = 0.05  # standard deviation of the distance of a part from the scene
_MOST_BEND = 1.7  # radians; people who bend more do not sit more probably
_SHOWN_SHARE = 0.5  # of the vertices of a part that the photo shows


def contact_parts(model: BodyModel) -> dict[str, Tensor]:
    """Return the vertices (V,) bool of each body part: the contact regions, with thighs and
    buttocks as one part.
    """
    regions = contact_regions(model)
    found: dict[str, Tensor] = {}
    for number, name in enumerate(regions.names):
        part = part_of_region(name)
        chosen = (regions.region == number) & model.outer
        found[part] = found[part] | chosen if part in found else chosen
    return found


def part_of_region(region: str) -> str:
    """Return the part of a region of contacts."""
    return SEAT if kind_of_part(region) == SEAT else region


def kind_of_part(part: str) -> str:
    """Return the kind of a part: "foot", "hand", "seat" or "other"; parts of one kind have one
    model.
    """
    return _KIND_OF.get(part.removeprefix("left_").removeprefix("right_"), "other")


def scene_contact(given: ContactInput, near: Distances) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the probability (N, V) that vertices touch scene or floor, and that of each part: name
    -> (N,).
    """
    at = near_scene(given, near)
    unseen = unseen_parts(given)
    parts = {}
    for name, features in part_features(given, at.gap).items():
        kind = kind_of_part(name)
        odds = torch.as_tensor(touch_log_odds(kind, features))
        if kind in _RATED:
            odds = torch.where(unseen[name], touch_log_odds(f"unseen {kind}", features), odds)
        parts[name] = torch.sigmoid(odds)
    limbs = given.part("hand", "foot")
    model = contact_model().nearness
    far_m, power = (
        torch.where(limbs, model[f"{name}, hand or foot"], model[name])
        for name in ("far_m", "facing")
    )
    of_vertex = torch.stack(list(parts.values()), 1)[:, _groups(given.model)]
    return of_vertex * nearness(at.rise, at.facing, far_m, power), parts


def unseen_parts(given: ContactInput) -> dict[str, Tensor]:
    """Return part -> (N,) bool: no pixel shows the part, nor a confident keypoint at its end."""
    shown = given.seen if given.in_mask is None else given.seen | given.in_mask
    parts = contact_parts(given.model)
    return {
        name: shown[:, chosen].double().mean(1) < _SHOWN_SHARE for name, chosen in parts.items()
    }


class NearScene(NamedTuple):
    """Distances of N people's parts and vertices from the scene.

    Attributes:
        gap: (N, P) signed distance of each part of :func:`contact_parts`, metres; inf if nothing is
            near.
        rise: (N, V) how much farther the vertex is than its part, metres, at least 0; inf if it is
            far.
        facing: (N, V) cosine between the skin and the surface that it faces.
    """

    gap: Tensor
    rise: Tensor
    facing: Tensor


def near_scene(given: ContactInput, near: Distances) -> NearScene:
    """Return where vertices are beside scene and floor.

    A part with nothing near it is compared with a level surface under its lowest vertices.
    """
    distance, facing = _to_scene(given, near)
    height = torch.where(given.model.outer, given.vertices @ given.up, torch.inf)
    group = _groups(given.model)
    gap = _gaps(given.model, distance)
    lowest = _gaps(given.model, height)
    lost = torch.isinf(gap)[:, group]
    rise = torch.where(lost, height - lowest[:, group], distance - gap[:, group])
    return NearScene(gap, torch.relu(rise), torch.where(lost, -(near.normals @ given.up), facing))


def nearness(rise: Tensor, facing: Tensor, far_m: Tensor, power: Tensor) -> Tensor:
    """Return the share of the probability of a part that its vertices have; see :class:`NearScene`.

    Args:
        rise: (...) metres.
        facing: (...) cosine.
        far_m: (...) rise at which half of the probability is left, metres.
        power: (...) of the cosine.
    """
    return ((1 + facing) / 2) ** power / (1 + (rise / far_m).square())


def part_features(given: ContactInput, gap: Tensor) -> dict[str, dict[str, Tensor]]:
    """Return part -> name of a feature -> values (N,): one reason for or against contact of the
    part with the scene.

    "distance" is that of the part in standard deviations, 0 inside, and at most that of the search
    radius. "bend at the hips" is the smaller angle between trunk and thighs, radians; 0 is
    straight. "depth beside", "hanging" and "holding" are those of the stance.

    Args:
        given: bodies, and what the photo shows of them.
        gap: (N, P) distance of each part, metres; inf if nothing is near.
    """
    joints = given.joints
    stance = given.stance or Stance.unknown(len(joints))
    beside, hanging, holding = (
        torch.tensor(values).to(joints)
        for values in (stance.depth_beside, stance.hanging, stance.holding)
    )
    bend = hip_bends(joints).amin(1).clamp(max=_MOST_BEND).nan_to_num()
    found: dict[str, dict[str, Tensor]] = {}
    for name, own in zip(contact_parts(given.model), gap.T, strict=True):
        found[name] = {DISTANCE: torch.relu(own).clamp(max=SEARCH_RADIUS_M) / _SIGMA_M}
        side = SIDES.index(name.partition("_")[0]) if name.startswith(SIDES) else 0
        column = {"foot": side, "hand": 2 + side, SEAT: 4}.get(kind_of_part(name))
        if column is not None:
            found[name][DEPTH_BESIDE] = beside[:, column]
        if kind_of_part(name) == "foot":
            found[name][HANGING] = hanging
        if kind_of_part(name) == "hand":
            found[name][HOLDING] = holding[:, side]
    found[SEAT]["bend at the hips"] = bend
    return found


def _gaps(model: BodyModel, distance: Tensor) -> Tensor:
    """Return the fifth smallest of the distances (N, V) of each part, (N, P)."""
    parts = contact_parts(model).values()
    return torch.stack([distance[:, chosen].kthvalue(_GAP_VERTICES).values for chosen in parts], 1)


def _groups(model: BodyModel) -> Tensor:
    """Return the row (V,) int64 of the part of each vertex in :func:`contact_parts`; 0 for inner
    vertices.
    """
    parts = torch.stack(list(contact_parts(model).values()))
    return parts.int().argmax(0)


def _to_scene(given: ContactInput, near: Distances) -> tuple[Tensor, Tensor]:
    """Return the distance (N, V) of outer vertices to scene or floor, and the cosine (N, V) with
    which they face it.

    The floor's plane is fitted to many points, so it gives the distance to the floor within reach.
    """
    surface = near.surface
    parts = near.parts
    by_plane = surface.on_floor
    towards = torch.zeros_like(near.normals)
    if len(parts.ground):
        ground = parts.ground[surface.point] & torch.isfinite(surface.scene)
        by_plane = by_plane | (ground & torch.isfinite(surface.floor))
        towards = given.surfaces.scene.normals[surface.point].to(towards)
    distance = torch.where(by_plane, surface.floor, surface.scene)
    towards = torch.where(by_plane[..., None], given.up, towards)
    return torch.where(given.model.outer, distance, torch.inf), -(near.normals * towards).sum(-1)
