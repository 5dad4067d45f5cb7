"""One palette: contact by what is touched, apart for every reader, with a legend of what a result
shows.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from physic_core.geometry import linear_from_srgb
from physic_core.types import ContactPartner
from physic_visual.palette import (
    BODY_RGB,
    CONTACT_PALETTE,
    contact_color,
    contact_colors,
    contact_legend,
)

# Machado, Oliveira and Fernandes 2009, severity 1, on linear sRGB.
READERS = {
    "full": np.eye(3),
    "without red cones": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "without green cones": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "without blue cones": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
TO_CONES = np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]])
TO_OKLAB = np.array(
    [[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]]
)


@pytest.mark.parametrize("reader", READERS)
def test_every_reader_tells_the_colours_of_contact_apart(reader):
    colors = np.array([*CONTACT_PALETTE.values(), BODY_RGB], np.uint8)
    perceived = np.clip(linear_from_srgb(colors) @ np.array(READERS[reader]).T, 0, 1)
    lab = np.cbrt(perceived @ TO_CONES.T) @ TO_OKLAB.T
    assert min(np.linalg.norm(one - other) for one, other in combinations(lab, 2)) > 0.13


@pytest.mark.parametrize(
    ("partner", "label"),
    [
        (ContactPartner("floor", "rug"), "floor"),
        (ContactPartner("scene", "seat", 1), "seat"),
        (ContactPartner("scene", "table", 3), "other surface"),
        (ContactPartner("person", person=1, part="left_hand"), "person"),
        (ContactPartner("self", part="torso"), "own body"),
        (ContactPartner("hidden", "seat"), "something hidden"),
    ],
)
def test_each_partner_has_the_colour_of_its_kind(partner, label):
    assert contact_color(partner) == CONTACT_PALETTE[label]


def test_vertices_and_legend_have_the_colours_of_what_is_touched(reconstruction):
    floor = ContactPartner("floor")
    seat = ContactPartner("scene", "seat", 1)
    unused = ContactPartner("self", part="head")
    person = reconstruction.people[0]
    partner = np.full(len(person.vertices), -1, np.int32)
    partner[:3] = 1, 0, 1
    person = replace(person, contact=partner >= 0, contact_partner=partner)
    result = replace(reconstruction, people=(person,), contact_partners=(floor, seat, unused))
    colors = contact_colors(person, result.contact_partners)
    wanted = [CONTACT_PALETTE["seat"], CONTACT_PALETTE["floor"], CONTACT_PALETTE["seat"], BODY_RGB]
    assert_array_equal(colors[:4], wanted)
    shown = ("floor", "seat")
    assert list(contact_legend(result).items()) == [(n, CONTACT_PALETTE[n]) for n in shown]
