"""Scores of contact partners: the truth is perfect, and each kind of error counts once and nowhere
else.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_bench.figures import figure
from physic_bench.worlds.columns import COLUMNS
from physic_bench.worlds.contact_partners import NO_CONTACT, ContactMap, contact_counts_by_partner
from physic_core.body import load_body
from physic_core.types import SURFACE_NAMES, ContactPartner
from physic_testing.worlds import load_world

SIZE = (96, 72)


def true_contacts(world):
    """The truth as an estimate: the scene goes before people, those before the own body and small
    objects.
    """
    partner = np.full(world.contact.shape, -1, np.int16)
    partners = []

    def add(rows, found):
        if (rows & (partner < 0)).any():
            partner[rows & (partner < 0)] = len(partners)
            partners.append(found)

    for name in np.unique(world.touched_surface[world.contact]):
        surface = SURFACE_NAMES[name]
        kind = "floor" if surface in ("floor", "ground") else "scene"
        add(
            world.contact & (world.touched_surface == name),
            ContactPartner(kind, surface, id=int(name)),
        )
    for person in range(len(world.masks)):
        add(world.touched_person == person, ContactPartner("person", person=person))
    for number, part in enumerate(world.parts):
        add(world.touched_own_part == number, ContactPartner("self", part=part))
    add(world.touched_item >= 0, ContactPartner("scene", "object", id=99))
    touching = partner >= 0
    return ContactMap(touching, touching.astype(np.float32), partner, tuple(partners))


def counted(world, contacts, person=0):
    people = {i: i for i in range(len(world.masks))}
    part = load_body(world.body_model).part_of_vertex.numpy()
    return contact_counts_by_partner(world, contacts, person, person, people, part)


def figures(*counts):
    people = [{"id": i, "group": "stand", **one} for i, one in enumerate(counts)]
    return {column.key: figure(people, column).value for column in COLUMNS}


@pytest.mark.parametrize("name", ["hands_on_hips", "hold_hands_view2", "hold_ball"])
def test_the_truth_is_perfect(name):
    world = load_world(name, SIZE)
    contacts = true_contacts(world)
    counts = [counted(world, contacts, i) for i in range(len(world.masks))]
    found = figures(*counts)
    assert found["partner_accuracy"] == found["scene_contact_f1"] == 1
    assert found["brier"] == found["ece"] == found["ece_likely"] == 0
    held = 2 * len(world.items)  # hands on a ball are in contact and do not carry
    assert all((one["support_misses"], one["support_false_alarms"]) == (0, held) for one in counts)
    if world.items:
        assert found["item_recall"] > 0.9  # what touches the ball and the own body has one partner
    if len(world.masks) > 1:
        assert found["people_contact_f1"] > 0.9


def test_a_missed_person_has_no_true_positives():
    world = load_world("hold_hands_view2", SIZE)
    counts = counted(world, NO_CONTACT)
    truth = counted(world, true_contacts(world))
    assert counts["scene_misses"] == truth["scene_hits"] == world.contact[0].sum()
    assert counts["people_misses"] == (world.touched_person[0] >= 0).sum()
    assert not any(
        value
        for name, value in counts.items()
        if name.endswith(("hits", "alarms", "found", "right"))
    )
    assert "reliability" not in counts


def test_a_wrong_partner_is_found_and_not_right():
    world = load_world("hold_hands_view2", SIZE)
    truth = true_contacts(world)
    people = tuple(replace(p, person=0) if p.kind == "person" else p for p in truth.partners)
    counts = counted(world, replace(truth, partners=people))
    before = counted(world, truth)
    wrong = truth.of_kind("person")[0].sum()
    assert wrong > 0
    assert before["partner_right"] - counts["partner_right"] == wrong
    assert counts["partner_found"] == before["partner_found"]
    assert counts["people_hits"] == before["people_hits"]


def test_probabilities_are_calibrated_by_hand():
    world = load_world("hands_on_hips", SIZE)
    truth = true_contacts(world)
    share = truth.touching[0, world.outer].mean()
    even = replace(truth, probability=np.full(truth.touching.shape, 0.25, np.float32))
    found = figures(counted(world, even))
    assert found["ece"] == found["ece_likely"] == pytest.approx(abs(0.25 - share), abs=1e-6)
    assert found["brier"] == pytest.approx(share * 0.75**2 + (1 - share) * 0.25**2, abs=1e-6)
    right = figures(
        counted(world, replace(truth, probability=np.full(truth.touching.shape, share)))
    )
    assert right["ece"] == pytest.approx(0, abs=1e-9)
