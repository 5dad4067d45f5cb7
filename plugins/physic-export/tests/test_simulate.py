"""``physic simulate``: a body that stands upright stays, and the controls move everybody."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from PIL import Image
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from physic_core import Reconstruction
from physic_core.body import load_body
from physic_core.body.joints import JOINT_NAMES
from physic_core.body.parameters import parameters_from_rotations
from physic_core.cli import main
from physic_core.errors import InputError
from physic_core.geometry.upright import transform_points
from physic_core.types import BodyContact, ContactPartner
from physic_core.types.support import Support, SupportState
from physic_core.visual.export.request import export_frame
from physic_export.simulate import CONTROLS, STAY_M, posture, simulate_people
from physic_export.simulate_picture import draw_motions
from physic_export.tiles import Tile

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def standing(result: Reconstruction) -> Reconstruction:
    return upright(result)


def upright(result: Reconstruction, heels_up: float = 0.0, lean: float = 0.0) -> Reconstruction:
    """The first person in a T-pose, upright, with the soles on a floor without a scene.

    Args:
        result: with a floor.
        heels_up: angle of the heels over the floor, radians; the toes are level.
        lean: angle of the body forward over its feet, radians.
    """
    model, floor = load_body("embedded").to(dtype=torch.float64), result.scene.floor
    up = np.asarray(floor.normal, np.float64)
    forward = np.array([0.0, 0.0, -1.0]) + up[2] * up
    forward /= np.linalg.norm(forward)
    rotations = torch.eye(3, dtype=torch.float64).repeat(1, 55, 1, 1)
    body = np.stack([np.cross(up, forward), up, forward], 1) @ Rotation.from_euler("x", lean).as_matrix()
    rotations[0, 0] = torch.from_numpy(body)
    for name, angle in (("ankle", heels_up - lean), ("foot", -heels_up)):
        turn = torch.from_numpy(Rotation.from_euler("x", angle).as_matrix())
        for joint in (JOINT_NAMES.index(f"{side}_{name}") for side in ("left", "right")):
            rotations[0, joint] = turn
    betas, transl = torch.zeros(1, 16, dtype=torch.float64), np.array([0.0, 0.0, 3.0])
    low = (model(rotations, betas, torch.from_numpy(transl[None])).vertices[0].numpy() @ up + floor.offset).min()
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
    return replace(result, people=(person,), scene=empty, contact_partners=(ContactPartner("floor"),))


def test_an_upright_body_stays_and_its_soles_keep_contact(standing: Reconstruction):
    (motion,) = simulate_people(standing, [0])
    assert motion.stays
    assert motion.moved_m < 0.02
    assert motion.slip_m is not None
    assert motion.slip_m < 0.01
    assert 2 <= motion.lasting <= motion.contacts
    assert motion.start.shape == motion.end.shape


def test_an_upright_body_stands_on_its_actuators(standing: Reconstruction, tmp_path: Path):
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(standing.export(str(tmp_path / "a.xml")).files[0]))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("photo").id)
    height, angles, worst = data.qpos[2], data.qpos[7:].copy(), 0.0
    while data.time < 2.0:
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[7:] - angles).max()))
    assert np.rad2deg(worst) < 1.0
    assert data.qpos[2] == pytest.approx(height, abs=0.01)


def test_a_balanced_body_whose_heels_are_a_centimetre_over_the_floor_stays(result: Reconstruction):
    (motion,) = simulate_people(upright(result, heels_up=np.deg2rad(7)), [0])
    assert motion.stays


@pytest.fixture(scope="module")
def leaning(result: Reconstruction) -> Reconstruction:
    """A body that leans backwards by 8 degrees over its feet, which carry it."""
    leaning = upright(result, lean=np.deg2rad(-8))
    feet = support(SupportState.UNBALANCED, ("left_foot", "right_foot"), FLOOR)
    return replace(leaning, people=(replace(leaning.people[0], support=feet),))


def test_a_body_that_leans_falls_and_the_option_balance_turns_it_until_it_stays(leaning: Reconstruction):
    (falls,), (stays,) = (simulate_people(leaning, [0], balance=balance) for balance in (False, True))
    assert falls.outcome == "falls"
    assert stays.outcome == "stays"
    assert falls.turn == ""
    angle = re.fullmatch(
        r"person 0 is turned by ([\d.]+) degrees about the ankles: the mass is 4.0 cm inside the edge of the soles",
        stays.turn,
    )
    assert angle is not None
    assert 3.0 < float(angle[1]) < 8.0


def test_an_exported_body_is_turned_over_its_soles_which_stay(leaning: Reconstruction, tmp_path: Path):
    import mujoco

    soles, centres = [], []
    for name, balance in (("as_it_is.xml", False), ("turned.xml", True)):
        done = leaning.export(str(tmp_path / name), balance=balance)
        assert any("degrees about the ankles" in note for note in done.notes) is balance
        model = mujoco.MjModel.from_xml_path(str(done.files[0]))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        spheres = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
        soles.append(data.geom_xpos[spheres])
        centres.append(data.subtree_com[model.body("person_0").id])
    np.testing.assert_allclose(soles[1], soles[0], atol=5e-3)
    edges = ConvexHull(soles[1][:, :2]).equations
    inside = [float(-(edges[:, :2] @ centre[:2] + edges[:, 2]).max()) for centre in centres]
    assert inside[0] < 0
    assert inside[1] == pytest.approx(0.04, abs=2e-3)


def test_who_sits_is_not_turned_and_rigid_people_cannot_be(leaning: Reconstruction, tmp_path: Path):
    seat = support(SupportState.BALANCED, ("left_foot", "seat"), FLOOR)
    sitter = replace(leaning, people=(replace(leaning.people[0], support=seat),))
    (motion,) = simulate_people(sitter, [0], seconds=0.1, balance=True)
    assert motion.turn == ""
    with pytest.raises(InputError, match="rigid people have no ankles to turn about: give either rigid or balance"):
        leaning.export(str(tmp_path / "a.xml"), rigid=True, balance=True)


@pytest.mark.parametrize("control", CONTROLS)
def test_a_person_does_not_stay_under_a_control(standing: Reconstruction, control: str):
    (motion,) = simulate_people(standing, [0], control=control)
    assert not motion.stays
    assert motion.moved_m > STAY_M
    assert motion.control == control


FLOOR, UNSEEN_SEAT = ContactPartner("floor"), ContactPartner("hidden", "seat")


@pytest.mark.parametrize(
    ("state", "parts", "partner", "words"),
    [
        (SupportState.BALANCED, ("left_foot", "right_foot"), FLOOR, "stands on both feet"),
        (SupportState.BALANCED, ("left_foot",), FLOOR, "in motion"),
        (SupportState.BALANCED, ("left_foot", "seat"), FLOOR, "sits"),
        (SupportState.BALANCED, ("left_foot", "left_upper_leg"), FLOOR, "sits"),
        (SupportState.UNBALANCED, ("left_foot", "right_foot"), FLOOR, "in motion"),
        (SupportState.UNBALANCED, ("left_foot", "right_foot", "seat"), FLOOR, "sits"),
        (SupportState.ASSUMED, ("seat",), UNSEEN_SEAT, "sits"),
        (SupportState.ASSUMED, ("left_upper_leg",), UNSEEN_SEAT, "sits"),
    ],
)
def test_the_posture_follows_from_the_support(
    standing: Reconstruction, state: SupportState, parts, partner: ContactPartner, words: str
):
    assert posture(replace(standing.people[0], support=support(state, parts, partner)), standing.scene.floor) == words


def test_a_body_whose_trunk_is_level_lies(standing: Reconstruction):
    on_floor = support(SupportState.BALANCED, ("seat", "back"), FLOOR)
    floor = standing.scene.floor
    level = replace(floor, normal=np.array([0.0, floor.normal[2], -floor.normal[1]]))
    assert posture(replace(standing.people[0], support=on_floor), level) == "lies"


def support(state: SupportState, parts, partner: ContactPartner) -> Support:
    contacts = tuple(BodyContact(part, partner, 0.9, 100) for part in parts)
    return Support(state, contacts, -0.1, (0.0, 0.0, 3.0))


def test_a_person_on_a_seat_that_the_scene_lacks_falls_and_the_command_says_why(
    standing: Reconstruction, tmp_path: Path
):
    up = standing.scene.floor.normal
    sitter = replace(
        standing.people[0],
        support=support(SupportState.ASSUMED, ("seat",), UNSEEN_SEAT),
        vertices=standing.people[0].vertices + 0.3 * up,
        joints=standing.people[0].joints + 0.3 * up,
        parameters=replace(
            standing.people[0].parameters, transl=standing.people[0].parameters.transl + np.float32(0.3) * up
        ),
        contact=np.zeros_like(standing.people[0].contact),
        contact_partner=np.full_like(standing.people[0].contact_partner, -1),
    )
    replace(standing, people=(sitter,)).save(str(tmp_path / "out"), "exact")
    done = CliRunner().invoke(main, ["simulate", str(tmp_path / "out"), "--seconds", "0.5"])
    assert done.exit_code == 0, done.output
    assert "note: the scene does not have the seat of person 0, who falls" in done.output
    (row,) = json.loads((tmp_path / "out" / "simulation.json").read_text())["people"]
    assert (row["posture"], row["outcome"], row["unseen_supports"]) == ("sits", "falls", ["hidden seat"])


def test_the_picture_has_the_floor_and_the_scene_that_carry(standing: Reconstruction):
    (motion,) = simulate_people(standing, [0], seconds=0.1)
    matrix = export_frame(standing.scene.floor, "z").from_camera
    x, y, _ = motion.start.mean(0)
    corners = np.array([[i, j, k] for i in (x + 0.6, x + 0.9) for j in (y, y + 0.3) for k in (0.0, 0.4)])
    hull = ConvexHull(corners)
    red = np.array([0.9, 0.1, 0.1])
    box = Tile(transform_points(np.linalg.inv(matrix), corners), hull.simplices.astype(np.int64), red)
    drawn = [np.array(Image.open(BytesIO(draw_motions([motion], 0.1, tiles, matrix)))) for tiles in ([], [box])]
    empty, furnished = (picture.astype(int) for picture in drawn)
    greys = (empty.max(2) - empty.min(2) < 8) & (empty.max(2) < 240)
    assert greys[200:].mean() > 0.3  # the chequered floor
    reds = furnished[..., 0] - furnished[..., 1] > 60
    assert reds.sum() > 500
    assert not (empty[..., 0] - empty[..., 1] > 60).any()


def test_the_command_writes_numbers_and_a_picture(standing: Reconstruction, tmp_path: Path):
    standing.save(str(tmp_path / "out"), "exact")
    done = CliRunner().invoke(main, ["simulate", str(tmp_path / "out"), "--seconds", "0.2", "-o", str(tmp_path / "s")])
    assert done.exit_code == 0, done.output
    head, row = done.output.splitlines()[:2]
    assert head.split()[:4] == ["person", "posture", "change", "outcome"]
    assert "stays" in row
    document = json.loads((tmp_path / "s" / "simulation.json").read_text())
    assert document["passive_joints"]["trunk"] == {"stiffness": 10000.0, "damping": 500.0, "friction": 5.0}
    assert document["people"][0]["stays"] is True
    with Image.open(tmp_path / "s" / "simulation.png") as picture:
        assert picture.size == (640, 320)


def test_a_file_of_the_user_is_not_replaced(saved_pair: Path, tmp_path: Path):
    (tmp_path / "simulation.png").write_text("mine")
    done = CliRunner().invoke(main, ["simulate", str(saved_pair), "-o", str(tmp_path)])
    assert done.exit_code == 2
    assert (tmp_path / "simulation.png").read_text() == "mine"


def test_a_person_who_does_not_exist_is_an_error(saved_pair: Path):
    done = CliRunner().invoke(main, ["simulate", str(saved_pair), "--person", "7"])
    assert done.exit_code == 3
    assert "there is no person 7 with a body: choose from [0, 1]" in done.output


def test_a_result_without_a_floor_is_an_error(standing: Reconstruction, tmp_path: Path):
    replace(standing, scene=replace(standing.scene, floor=None)).save(str(tmp_path / "out"), "exact")
    done = CliRunner().invoke(main, ["simulate", str(tmp_path / "out")])
    assert done.exit_code == 3
    assert done.output == "Error: physic simulate needs the direction of gravity, and this result has no floor\n"


def test_the_table_has_a_row_for_each_control(standing: Reconstruction, tmp_path: Path):
    standing.save(str(tmp_path / "out"), "exact")
    done = CliRunner().invoke(main, ["simulate", str(tmp_path / "out"), "--controls"])
    assert done.exit_code == 0, done.output
    rows = json.loads((tmp_path / "out" / "simulation.json").read_text())["people"]
    assert [(row["control"], row["stays"]) for row in rows] == [("", True), *((name, False) for name in CONTROLS)]
    assert all(name in done.output for name in CONTROLS)
