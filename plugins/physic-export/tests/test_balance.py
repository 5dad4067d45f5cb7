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


@pytest.fixture(scope="module")
def standing(result):
    return upright(result)


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
    body = (
        np.stack([np.cross(up, forward), up, forward], 1)
        @ Rotation.from_euler("x", lean).as_matrix()
    )
    rotations[0, 0] = torch.from_numpy(body)
    for joint in (JOINT_NAMES.index(f"{side}_ankle") for side in ("left", "right")):
        rotations[0, joint] = torch.from_numpy(Rotation.from_euler("x", -lean).as_matrix())
    bend = Rotation.from_euler("x", knee).as_matrix()
    rotations[0, JOINT_NAMES.index("right_knee")] = torch.from_numpy(bend)
    betas = torch.zeros(1, 16, dtype=torch.float64)
    transl = np.array([0.0, 0.0, 3.0])
    low = (
        model(rotations, betas, torch.from_numpy(transl[None])).vertices[0].numpy() @ up
        + floor.offset
    ).min()
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
    return replace(
        result, people=(person,), scene=empty, contact_partners=(ContactPartner("floor"),)
    )


def test_an_upright_body_stands_on_its_actuators(standing, tmp_path, simulated):
    import mujoco

    model, data = simulated(standing.export(str(tmp_path / "a.xml")).files[0])
    height = data.qpos[2]
    angles = data.qpos[7:].copy()
    worst = 0.0
    while data.time < 2.0:
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[7:] - angles).max()))
    assert np.rad2deg(worst) < 1.0
    assert data.qpos[2] == pytest.approx(height, abs=0.01)


@pytest.fixture(scope="module")
def leaning(result):
    """A body that leans backwards by 8 degrees over its feet, which carry it."""
    leaning = upright(result, lean=np.deg2rad(-8))
    feet = support(SupportState.BALANCED, ("left_foot", "right_foot"), FLOOR)
    return replace(leaning, people=(replace(leaning.people[0], support=feet),))


def test_an_exported_body_is_turned_over_its_soles_which_stay(leaning, tmp_path, simulated):
    soles = []
    centres = []
    for name, turned in (("as_it_is.xml", False), ("turned.xml", True)):
        done = leaning.export(str(tmp_path / name), keep_lean=not turned)
        turns = [
            found[1] for note in done.notes if (found := re.search(r"by ([\d.]+) degrees", note))
        ]
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
    leaning, tmp_path, rise_of_heads
):
    turned, as_seen = (
        rise_of_heads(leaning.export(str(tmp_path / f"{lean}.xml"), keep_lean=lean).files[0])
        for lean in (False, True)
    )
    assert turned == pytest.approx([0], abs=0.03)
    assert as_seen[0] < -0.3


def test_a_foot_that_touches_the_floor_has_its_sole_there_if_the_pose_has_it_higher(
    leaning, tmp_path, simulated
):
    person = leaning.people[0]
    up = np.asarray(leaning.scene.floor.normal, np.float64)
    lifted = replace(person, contacts=person.support.contacts)
    raised = replace(leaning.scene.floor, offset=leaning.scene.floor.offset + 0.05)
    higher = replace(leaning, people=(lifted,), scene=replace(leaning.scene, floor=raised))
    assert (person.vertices @ up + raised.offset).min() > 0.04
    model, data = simulated(higher.export(str(tmp_path / "a.xml"), keep_lean=True).files[0])
    soles = [i for i in range(model.ngeom) if re.search(r"(ankle|foot)_\d", model.geom(i).name)]
    np.testing.assert_allclose(data.geom_xpos[soles, 2], model.geom_size[soles, 0], atol=1e-3)


def test_a_foot_far_over_the_floor_does_not_balance_a_person_though_it_is_said_to_touch(
    result, tmp_path, rise_of_heads
):
    made = upright(result, knee=np.deg2rad(70))
    feet = support(SupportState.BALANCED, ("left_foot", "right_foot"), FLOOR)
    person = replace(made.people[0], support=feet, contacts=feet.contacts)
    done = replace(made, people=(person,)).export(str(tmp_path / "a.xml"))
    (note,) = (note for note in done.notes if note.startswith("person 0"))
    assert re.search(r"turned by [\d.]+ degrees", note)
    assert rise_of_heads(done.files[0]) == pytest.approx([0], abs=0.03)


def test_who_stands_on_a_raised_surface_stands_on_a_step_as_others_on_the_floor(
    leaning, tmp_path, rise_of_heads
):
    feet = support(SupportState.BALANCED, ("left_foot", "right_foot"), ContactPartner("scene"))
    raised = replace(leaning.scene.floor, offset=leaning.scene.floor.offset + 0.5)
    person = replace(leaning.people[0], support=feet, contacts=feet.contacts)
    high = replace(leaning, people=(person,), scene=replace(leaning.scene, floor=raised))
    done = high.export(str(tmp_path / "a.xml"))
    assert rise_of_heads(done.files[0]) == pytest.approx([0], abs=0.03)
    assert not any("fall" in note for note in done.notes)
    (note,) = high.export(str(tmp_path / "b.xml"), scene=False).notes
    assert note.startswith("person 0 falls")


def test_people_who_touch_each_other_do_not_push_each_other_over(
    leaning, tmp_path, simulated, rise_of_heads
):
    person = leaning.people[0]
    beside = np.array([1.5, 0.0, 0.0], np.float32)  # the hands of two T-poses overlap
    other = replace(person, vertices=person.vertices + beside, joints=person.joints + beside)
    moved = replace(other.parameters, transl=other.parameters.transl + beside)
    pair = replace(leaning, people=(person, replace(other, parameters=moved)))
    file = pair.export(str(tmp_path / "a.xml")).files[0]
    assert rise_of_heads(file, people=2) == pytest.approx([0, 0], abs=0.03)
    assert simulated(file)[0].nexclude > 0


@pytest.mark.parametrize(
    ("state", "parts", "said"),
    [
        (SupportState.BALANCED, ("left_foot", "right_foot"), {"ankles"}),
        (SupportState.BALANCED, ("left_foot", "seat"), set()),
        (SupportState.UNSTEADY, ("left_foot", "right_foot"), {"ankles", "may fall"}),
        (SupportState.UNBALANCED, ("left_foot",), {"person 0 falls"}),
        (SupportState.AIRBORNE, ("left_foot",), {"person 0 falls"}),
    ],
)
def test_the_export_says_who_is_turned_and_who_falls(leaning, tmp_path, state, parts, said):
    person = replace(leaning.people[0], support=support(state, parts, FLOOR))
    notes = " ".join(replace(leaning, people=(person,)).export(str(tmp_path / "a.xml")).notes)
    assert {words for words in ("ankles", "may fall", "person 0 falls") if words in notes} == said


def support(state, parts, partner):
    contacts = tuple(BodyContact(part, partner, 0.9, 100) for part in parts)
    return Support(state, contacts, -0.1, (0.0, 0.0, 3.0))
