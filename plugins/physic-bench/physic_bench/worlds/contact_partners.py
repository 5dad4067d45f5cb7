"""Scores of what each contact vertex touches, how surely, and what supports a person, against the
truth of a world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from physic_bench.worlds.columns import BINS
from physic_core.engine.limbs import observed_parts
from physic_core.types import SURFACE_NAMES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, ContactPartner, FloatArray, Support
    from physic_testing.worlds import World

_FEWEST = 10  # vertices of a body part that carries, as in a reported support
_GROUND = ("floor", "ground", "rug")
_PARTS_OF_REGION = {"back": ("torso",), "seat": ("torso", "left_upper_leg", "right_upper_leg")}


@dataclass(frozen=True)
class ContactMap:
    """Estimated contact of N people with anything.

    Attributes:
        touching: (N, V) bool.
        probability: (N, V) of contact; None if it is not estimated.
        partner: (N, V) int16, index into ``partners``, -1 without contact.
        partners: everything that people touch.
    """

    touching: BoolArray
    probability: FloatArray | None
    partner: NDArray[np.int16]
    partners: Sequence[ContactPartner]

    def of_kind(self, *kinds: str) -> BoolArray:
        """Return the vertices (N, V) in contact with partners of some kinds."""
        chosen = np.array([*(partner.kind in kinds for partner in self.partners), False])
        found: BoolArray = self.touching & chosen[self.partner]
        return found

    def with_scene(self) -> BoolArray:
        """Return the vertices (N, V) in contact with floor, scene or a hidden support."""
        return self.of_kind("floor", "scene", "hidden")


NO_CONTACT = ContactMap(np.zeros((1, 1), bool), None, np.full((1, 1), -1, np.int16), ())
"""Contact map of somebody who was not found."""


def contact_counts_by_partner(
    world: World,
    contacts: ContactMap,
    row: int,
    person: int,
    true_person: Mapping[int, int],
    part: NDArray[np.int64],
) -> dict[str, Any]:
    """Count right and wrong contacts of one person.

    Args:
        world: ground truth.
        contacts: estimate.
        row: of the person in the estimate.
        person: the same person in the world.
        true_person: row in the estimate -> person in the world.
        part: (V,) body part of each vertex, index into ``world.parts``.

    Returns:
        For each kind of contact (``scene``, ``people``, ``self``, ``support``) the counts
        ``KIND_hits``, ``KIND_false_alarms``, ``KIND_misses``; for partners ``partner_found`` and
        ``partner_right``; for small objects ``item_found`` and ``item_missed``; and, if
        probabilities are estimated, ``brier_sum``, ``brier_count`` and
        ``reliability``: (BINS, 3) number of vertices, sum of probabilities and number of true
            contacts; and the same of
        limbs that the photo does not show, ``reliability_unseen``.
    """
    outer = np.asarray(world.outer)
    item = world.touched_item[person] >= 0
    truth = {
        "scene": np.asarray(world.contact[person]),
        "people": world.touched_person[person] >= 0,
        "self": world.touched_own_part[person] >= 0,
    }
    found = {
        "scene": contacts.with_scene()[row] & ~item,
        "people": contacts.of_kind("person")[row],
        "self": contacts.of_kind("self")[row],
    }
    counts: dict[str, Any] = {}
    for kind, true in truth.items():
        counts |= _counts(kind, found[kind] & outer, true)
    carrying = (
        np.bincount(part[mask], minlength=len(world.parts)) >= _FEWEST
        for mask in (
            contacts.with_scene()[row] & outer,
            np.asarray(world.support[person]),
        )
    )
    counts |= _counts("support", *carrying)
    anything = item | truth["scene"] | truth["people"] | truth["self"]
    both = anything & contacts.touching[row] & outer
    right = _right_partner(world, contacts, row, person, true_person) & both
    objects = np.array(
        [*(one.surface == "object" or one.kind == "object" for one in contacts.partners), False]
    )
    on_object = contacts.touching[row] & objects[contacts.partner[row]]
    counts |= {
        "partner_found": int(both.sum()),
        "partner_right": int(right.sum()),
        "item_found": int((item & on_object).sum()),
        "item_missed": int((item & ~on_object).sum()),
    }
    if contacts.probability is not None:
        likely = contacts.probability[row].astype(np.float64)
        counts |= _calibration(likely[outer], anything[outer])
        unseen = outer & ~_shown_limbs(world, person)[part]
        counts["reliability_unseen"] = _calibration(likely[unseen], anything[unseen])["reliability"]
    return counts


def reported_support_counts(
    support: Support | None, carrying: BoolArray, names: Sequence[str], region: NDArray[np.int64]
) -> dict[str, int]:
    """Count right and wrong body parts that carry one person.

    Args:
        support: reported; None counts as no support.
        carrying: (V,) vertices that truly carry the person.
        names: of the parts.
        region: (V,) part of each vertex, see
            :func:`physic_core.engine.contact.parts.contact_regions`.

    Returns:
        The counts ``reported_support_hits``, ``reported_support_false_alarms`` and
        ``reported_support_misses``.
    """
    vertices = np.bincount(region[carrying], minlength=len(names))
    true = {name for name, count in zip(names, vertices, strict=True) if count >= _FEWEST}
    found = {contact.part for contact in support.contacts} if support is not None else set()
    return {
        "reported_support_hits": len(found & true),
        "reported_support_false_alarms": len(found - true),
        "reported_support_misses": len(true - found),
    }


def _counts(kind: str, found: BoolArray, true: BoolArray) -> dict[str, int]:
    """Return hits, false alarms and misses of one kind of contact."""
    return {
        f"{kind}_hits": int((found & true).sum()),
        f"{kind}_false_alarms": int((found & ~true).sum()),
        f"{kind}_misses": int((~found & true).sum()),
    }


def _right_partner(
    world: World, contacts: ContactMap, row: int, person: int, true_person: Mapping[int, int]
) -> BoolArray:
    """Return the vertices (V,) whose estimated partner is one of those that they truly touch."""
    surface = np.array(SURFACE_NAMES)[world.touched_surface[person]]
    parts = np.array([*world.parts, ""])
    own = parts[world.touched_own_part[person]]
    right = np.zeros(len(own), bool)
    for index, partner in enumerate(contacts.partners):
        here = contacts.partner[row] == index
        if partner.kind == "floor":
            true = np.isin(surface, _GROUND)
        elif partner.kind == "person":
            true = world.touched_person[person] == true_person.get(
                -1 if partner.person is None else partner.person, -2
            )
        elif partner.kind == "self":
            true = np.isin(own, _PARTS_OF_REGION.get(partner.part, (partner.part,)))
        else:
            standing = world.contact[person] & ~np.isin(surface, _GROUND)
            true = standing & (surface == partner.surface if partner.surface else True)
            if partner.surface == "object" or partner.kind == "object":
                true = true | (world.touched_item[person] >= 0)
        right |= here & true
    return right


def _shown_limbs(world: World, person: int) -> BoolArray:
    """Return the body parts (P,) bool of a person whose end the photo shows."""
    visible = torch.from_numpy(np.array(world.joints_visible[person], bool))
    return np.asarray(observed_parts(world.parts, visible[None])[0].numpy())


def _calibration(probability: FloatArray, true: BoolArray) -> dict[str, Any]:
    """Return the sums of the Brier score and of the reliability diagram for vertices (n,)."""
    bins = np.minimum((probability * BINS).astype(np.int64), BINS - 1)
    sums = [
        np.bincount(bins, weights, BINS)
        for weights in (np.ones(len(bins)), probability, true.astype(np.float64))
    ]
    return {
        "brier_sum": float(((probability - true) ** 2).sum()),
        "brier_count": len(probability),
        "reliability": np.stack(sums, axis=1).tolist(),
    }
