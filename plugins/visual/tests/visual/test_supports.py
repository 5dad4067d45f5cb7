"""Slabs under what the photo does not show: assumed seats, steps and handholds."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from physic_core.geometry.world_frame import up_in_camera
from physic_core.types.contacts import BodyContact, ContactPartner, Support, SupportState
from physic_visual.assumed_supports import SLAB_FACES, assumed_supports
from physic_visual.glb import combined_glb


def assumed(result, part, on):
    """The result with a hidden support under some vertices of person 0."""
    partner = ContactPartner("hidden", "seat" if part == "seat" else "")
    contact = BodyContact(part, partner, 0.7, int(on.sum()))
    person = result.people[0]
    support = Support(SupportState.ASSUMED, (contact,), -0.1, (0.0, 0.0, 3.0))
    sits = replace(
        person, contact=on, contact_partner=np.where(on, 0, -1).astype(np.int16), support=support
    )
    return replace(result, people=(sits,), contact_partners=(partner,))


@pytest.fixture
def heights(result):
    return np.asarray(result.people[0].vertices @ up_in_camera(result.scene.floor))


def lowest(result, heights):
    mesh = result.people[0].mesh()
    down = mesh.vertex_normals @ up_in_camera(result.scene.floor) < -0.7
    return down & (heights < heights.min() + 0.05)


def test_a_slab_lies_level_under_the_skin_on_it(result, heights):
    on = lowest(result, heights)
    (slab,) = assumed_supports(assumed(result, "seat", on))
    assert slab.name == "assumed seat"
    levels = slab.vertices @ up_in_camera(result.scene.floor)
    assert_allclose(sorted(levels)[4:], np.median(heights[on]), atol=1e-6)
    assert np.ptp(levels) < 0.05
    mesh = trimesh.Trimesh(slab.vertices, SLAB_FACES, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0
    lowered = np.outer(heights[on] - levels.mean(), up_in_camera(result.scene.floor))
    assert mesh.contains(result.people[0].vertices[on] - lowered).all()


def test_a_slab_has_the_name_of_what_it_carries(result, heights):
    on = lowest(result, heights)
    (slab,) = assumed_supports(assumed(result, "left_foot", on))
    assert slab.name == "assumed support"
    assert not assumed_supports(result)


def test_a_glb_has_a_node_for_each_assumed_support(result, heights):
    content = combined_glb(assumed(result, "seat", lowest(result, heights)))
    tree = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])
    (node,) = (one for one in tree["nodes"] if one["name"].startswith("assumed"))
    assert node["name"] == "assumed_seat_of_person_0"
    (primitive,) = tree["meshes"][node["mesh"]]["primitives"]
    assert tree["materials"][primitive["material"]]["alphaMode"] == "BLEND"
