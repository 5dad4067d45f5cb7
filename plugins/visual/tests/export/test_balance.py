"""Bodies that stand: actuators hold them, and those that lean are turned over their soles."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from physic_core.body import load_body
from physic_core.body.bones import parameters_from_rotations
from physic_core.body.joints import JOINT_NAMES
from physic_core.types import BodyContact, ContactPartner
from physic_core.types.contacts import Support, SupportState

pytest.importorskip("mujoco")

FLOOR = ContactPartner("floor")


def upright(result, lean=0.0, knee=0.0):
    """The first person in a T-pose, upright, with the soles on a floor without a scene.

    Args:
        result: with a floor.
        lean: angle of the body forward over its feet, radians.
        knee: bend of the right knee, which lifts the foot behind the body, radians.
    """
    model = load_body("embedded").to(dtype=torch.float64)
    floor = result.scene.floor
    up = np.asarray(floor.normal, np.float64)
    forward = np.array([0.0, 0.0, -1.0]) + up[2] * up
    forward /= np.linalg.norm(forward)
    rotations = torch.eye(3, dtype=torch.float64).repeat(1, 55, 1, 1)
    bends = {"pelvis": lean, "left_ankle": -lean, "right_ankle": -lean, "right_knee": knee}
    for name, angle in bends.items():
        turn = Rotation.from_euler("x", angle).as_matrix()
        rotations[0, JOINT_NAMES.index(name)] = torch.from_numpy(turn)
    facing = torch.from_numpy(np.stack([np.cross(up, forward), up, forward], 1))
    rotations[0, 0] = facing @ rotations[0, 0]
    betas = torch.zeros(1, 16, dtype=torch.float64)
    transl = np.array([0.0, 0.0, 3.0])
    lying = model(rotations, betas, torch.from_numpy(transl[None])).vertices[0].numpy()
    low = (lying @ up + floor.offset).min()
    place = torch.from_numpy((transl - low * up)[None])
    posed = model(rotations, betas, place)
    person = replace(
        result.people[0],
        parameters=parameters_from_rotations(rotations, betas, None, place),
        vertices=posed.vertices[0].numpy().astype(np.float32),
        joints=posed.joints[0].numpy().astype(np.float32),
    )
    empty = replace(result.scene, valid=np.zeros_like(result.scene.valid))
    soles = person.vertices @ up + floor.offset < 0.01
    partner = np.where(soles, 0, -1).astype(np.int16)
    person = replace(person, contact=soles, contact_partner=partner)
    return replace(result, people=(person,), scene=empty, contact_partners=(FLOOR,))


def changed(result, raised_m=0.0, **changes):
    """The result with changes of its person, and with the floor nearer to the camera."""
    floor = result.scene.floor
    scene = replace(result.scene, floor=replace(floor, offset=floor.offset + raised_m))
    return replace(result, people=(replace(result.people[0], **changes),), scene=scene)


def support(state, parts=("left_foot", "right_foot"), partner=FLOOR):
    contacts = tuple(BodyContact(part, partner, 0.9, 100) for part in parts)
    return Support(state, contacts, -0.1, (0.0, 0.0, 3.0))


BALANCED = support(SupportState.BALANCED)


@pytest.fixture(scope="module")
def leaning(result):
    """A body that leans backwards by 8 degrees over its feet, which carry it."""
    return changed(upright(result, lean=np.deg2rad(-8)), support=BALANCED)


def test_an_exported_body_is_turned_over_its_soles_which_stay(leaning, export, simulated):
    soles = []
    centres = []
    for name, turned in (("as_it_is.xml", False), ("turned.xml", True)):
        done = export(name, of=leaning, keep_lean=not turned)
        turns = re.findall(r"by ([\d.]+) degrees", "\n".join(done.notes))
        assert len(turns) == turned
        assert all(3.0 < float(angle) < 8.0 for angle in turns)
        model, data = simulated(done.files[0])
        spheres = [i for i in range(model.ngeom) if re.search(r"ankle_\d", model.geom(i).name)]
        soles.append(data.geom_xpos[spheres])
        centres.append(data.subtree_com[model.body("person_0").id])
    np.testing.assert_allclose(soles[1], soles[0], atol=5e-3)
    edges = ConvexHull(soles[1][:, :2]).equations
    inside = [float(-(edges[:, :2] @ centre[:2] + edges[:, 2]).max()) for centre in centres]
    assert inside[0] < 0
    assert inside[1] == pytest.approx(0.04, abs=2e-3)


@pytest.fixture
def rise_of_heads(simulated):
    """A function that gives how far heads have risen after one and a half seconds, metres."""

    def rise(file, people=1):
        before, after = (simulated(file, seconds)[1] for seconds in (0.0, 1.5))
        names = [f"person_{number}_head" for number in range(people)]
        return [float(after.body(n).xpos[2] - before.body(n).xpos[2]) for n in names]

    return rise


def test_who_is_balanced_within_the_error_of_the_lean_stays_up_and_falls_with_the_lean_of_the_photo(
    leaning, export, rise_of_heads
):
    turned, as_seen = (
        rise_of_heads(export(f"{lean}.xml", of=leaning, keep_lean=lean).files[0])
        for lean in (False, True)
    )
    assert turned == pytest.approx([0], abs=0.03)
    assert as_seen[0] < -0.3


def test_who_stands_on_a_raised_surface_stands_on_a_step_as_others_on_the_floor(
    leaning, export, rise_of_heads
):
    feet = support(SupportState.BALANCED, partner=ContactPartner("scene", id=0))
    high = changed(leaning, raised_m=0.5, support=feet, contacts=feet.contacts)
    done = export("a.xml", of=high)
    assert rise_of_heads(done.files[0]) == pytest.approx([0], abs=0.03)
    assert not any("fall" in note for note in done.notes)
    (note,) = export("b.xml", of=high, scene=False).notes
    assert note.startswith("person 0 falls")


@pytest.mark.parametrize(
    ("state", "parts", "wanted"),
    [
        (SupportState.BALANCED, ("left_foot", "right_foot"), {"ankles"}),
        (SupportState.BALANCED, ("left_foot", "seat"), set()),
        (SupportState.UNSTEADY, ("left_foot", "right_foot"), {"ankles", "may fall"}),
        (SupportState.UNBALANCED, ("left_foot",), {"person 0 falls"}),
        (SupportState.AIRBORNE, ("left_foot",), {"person 0 falls"}),
    ],
)
def test_the_export_says_who_is_turned_and_who_falls(leaning, export, state, parts, wanted):
    reconstruction = changed(leaning, support=support(state, parts))
    notes = " ".join(export("a.xml", of=reconstruction).notes)
    assert {words for words in ("ankles", "may fall", "person 0 falls") if words in notes} == wanted
