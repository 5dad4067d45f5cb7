"""Scores of reported supports: right, additional and missing body parts are counted once each."""

from __future__ import annotations

import numpy as np
import pytest

from physic_bench.worlds.contact_partners import reported_support_counts
from physic_core.body import load_body
from physic_core.engine.contact.parts import contact_regions
from physic_core.types import BodyContact, ContactPartner, Support

MODEL = load_body("embedded")
NAMES, REGION = contact_regions(MODEL)


def support(*parts):
    contacts = tuple(BodyContact(part, ContactPartner("floor", "floor"), 0.9, 40) for part in parts)
    return Support("balanced", contacts, 0.0, (0.0, 0.0, 3.0))


def vertices(*parts, count=40):
    chosen = np.zeros(MODEL.num_vertices, bool)
    for part in parts:
        chosen[np.flatnonzero(REGION.numpy() == NAMES.index(part))[:count]] = True
    return chosen


def counts_of(reported, carrying):
    return reported_support_counts(reported, carrying, NAMES, REGION.numpy())


@pytest.mark.parametrize(
    ("reported", "true", "counts"),
    [
        (("left_foot", "seat"), ("left_foot", "seat"), (2, 0, 0)),
        (("left_foot", "back"), ("left_foot", "seat"), (1, 1, 1)),
        ((), ("left_foot", "seat"), (0, 0, 2)),
        (("left_hand",), (), (0, 1, 0)),
    ],
)
def test_each_part_of_a_support_is_counted_once(reported, true, counts):
    found = counts_of(support(*reported), vertices(*true))
    assert tuple(found.values()) == counts


def test_a_person_without_a_support_misses_every_true_part():
    assert counts_of(None, vertices("left_foot"))["reported_support_misses"] == 1


def test_fewer_than_ten_vertices_do_not_carry():
    found = counts_of(support(), vertices("left_foot", count=9))
    assert sum(found.values()) == 0
