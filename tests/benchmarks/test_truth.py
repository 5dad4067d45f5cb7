"""``benchmarks/truth`` on made-up truth: an error that is put in by hand comes out as that
number.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.figures import truth_figures
from benchmarks.truth import command, measures, scores, sets, table, triangulation
from benchmarks.truth import joints as limbs
from physic_bench import cameras

STANDING = {
    "left_shoulder": (0.2, -0.5, 3.0),
    "right_shoulder": (-0.2, -0.5, 3.0),
    "left_elbow": (0.25, -0.2, 3.0),
    "right_elbow": (-0.25, -0.2, 3.0),
    "left_wrist": (0.3, 0.05, 3.0),
    "right_wrist": (-0.3, 0.05, 2.8),
    "left_hip": (0.1, 0.0, 3.0),
    "right_hip": (-0.1, 0.0, 3.0),
    "left_knee": (0.1, 0.45, 2.95),
    "right_knee": (-0.1, 0.45, 2.95),
    "left_ankle": (0.1, 0.9, 3.0),
    "right_ankle": (-0.1, 0.9, 3.0),
}
K = np.array([[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]])
UP = np.array([0.0, -1.0, 0.0])


@pytest.fixture
def joints():
    return limbs.limb_joints(STANDING, 3)


def person_of(joints, contact=None):
    """A person of an answer whose body has these joints, and whose keypoints are exact."""
    body = np.zeros((55, 3))
    body[limbs.BODY_ROWS] = joints
    pixels = joints @ K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    keypoints = np.column_stack([pixels, np.ones(12)])
    box = [*(pixels.min(0) - 20), *(pixels.max(0) + 20)]
    return {
        "box": box,
        "joints": body.tolist(),
        "keypoints": keypoints.tolist(),
        "parts": contact or {},
    } | {"usable": ["pose", "place", "size"]}


def moved(points, *by):
    return np.asarray(points, np.float64) + np.array(by)


def answer_with(*people, **more):
    answer = {
        "error": "",
        "people": list(people),
        "camera": [1000, 1000, 500, 400],
        "floor": [0, -1, 0, 1.0],
    }
    return answer | more


def test_a_person_who_sits_bends_or_lies_is_not_upright(joints):
    row = limbs.ROW
    sitting = joints.copy()
    bent = joints.copy()
    for side in ("left", "right"):
        sitting[row[f"{side}_knee"]] = joints[row[f"{side}_hip"]] + [0, 0, -0.45]
        sitting[row[f"{side}_ankle"]] = sitting[row[f"{side}_knee"]] + [0, 0.45, 0]
        bent[row[f"{side}_shoulder"]] = joints[row[f"{side}_hip"]] + [0, 0, -0.5]
    lying = joints[:, [1, 0, 2]]
    assert limbs.is_upright(joints, UP)
    assert not limbs.is_upright(sitting, None)
    assert not limbs.is_upright(bent, UP)
    assert limbs.is_upright(lying, None)
    assert not limbs.is_upright(lying, UP)


def test_a_person_is_found_by_box_or_keypoints():
    full = [0, 0, 100, 200]
    upper = [0, 0, 100, 80]
    far = [300, 0, 400, 200]
    points = np.column_stack([np.linspace(10, 90, 12), np.linspace(10, 70, 12)])
    nowhere = np.full((12, 2), np.nan)
    match = measures.match_people
    assert match([upper], [nowhere], [full], [nowhere]) == {}
    assert match([upper], [points], [full], [points]) == {0: 0}
    assert match([far, full], [nowhere] * 2, [full], [nowhere]) == {0: 1}


def test_contact_is_five_percent_of_the_largest_force_of_the_film():
    forces = np.zeros((2, 4, 6))
    forces[0, 0, 2] = 1000
    forces[1, 1, :3] = 0, 30, 41
    forces[1, 2, :3] = 0, 30, 39
    forces[1, 3, 3:] = 900  # moments are not forces
    assert measures.true_contact(forces).tolist() == [
        [True, False, False, False],
        [False, True, False, False],
    ]


def test_known_probabilities_have_the_known_scores():
    found = measures.probability_scores([0.9, 0.5, 0.2, 0.5, 0.1], [True, True, True, False, False])
    assert found == {
        "auc": pytest.approx((2 + 1.5 + 1) / 6),
        "brier": pytest.approx((0.01 + 0.25 + 0.64 + 0.25 + 0.01) / 5),
        "constant": pytest.approx(0.24),
        "recall": pytest.approx(2 / 3),
        "specificity": pytest.approx(1 / 2),
        "balanced": pytest.approx((2 / 3 + 1 / 2) / 2),
        "calibration": pytest.approx((0.1 + 0 + 0.8 + 0.1) / 5),
    }
    alike = measures.probability_scores([0.9, 0.2], [True, True])
    assert (alike["recall"], alike["constant"], alike["brier"]) == (0.5, 0, pytest.approx(0.325))
    assert all(math.isnan(alike[name]) for name in ("auc", "specificity", "balanced"))


def ring(count=5):
    """Cameras around the origin that look at it from 4 m, the world's y down."""
    views = []
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        cos = np.cos(angle)
        sin = np.sin(angle)
        turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
        views.append(cameras.Camera(K, 1000, 800, turn, np.array([0.0, 0.1, 4.0])))
    return views


@pytest.fixture
def people(joints):
    """Two people in the world, side by side."""
    centred = joints - [0, 0.2, 3]
    return [
        moved(centred, 0.5, 0, 0),
        moved(0.9 * centred @ np.diag([-1.0, 1, -1]), -0.5, 0.1, 0.3),
    ]


def test_people_are_matched_across_views(people):
    cameras = ring()
    rng = np.random.default_rng(1)
    views = []
    order = []
    for camera in cameras:
        mine = rng.permutation(2)
        order.append(mine)
        views.append([camera.project(people[i]) + rng.normal(0, 2, (12, 2)) for i in mine])
    views[1].append(rng.uniform(0, 800, (12, 2)))  # seen by one camera alone: nobody
    del views[4][list(order[4]).index(0)]
    found = triangulation.match_views(cameras, views)
    assert [len(person.members) for person in found] == [5, 4]
    for person, i in zip(found, (1, 0), strict=True):
        assert np.linalg.norm(person.joints - people[i], axis=-1).max() < 0.03
        assert all(order[v][member] == i for v, member in person.members.items() if v != 4)


def alone(joints):
    """A sample of mpi_inf_3dhp with its floor a metre under the camera."""
    facts = {
        "joints": dict(zip(limbs.LIMB_JOINTS, joints.tolist(), strict=True)),
        "K": K.tolist(),
        "up": UP.tolist(),
        "floor_point": [0.3, 1.0, 2.0],
    }
    return sets.Sample("mpi_inf_3dhp", "one", "one", Path("one.jpg"), K=K, truth=facts)


def figures_of(joints, answer):
    records = scores.compared([alone(joints)], [answer])
    return {row.figure.name: row.this for row in table.rows_of(records) if row.count}


def test_a_person_too_near_comes_out_in_the_table(joints):
    found = figures_of(joints, answer_with(person_of(0.9 * joints), floor=[0, -1, 0, 1.05]))
    assert found["people missed, %, mpi_inf_3dhp"] == 0
    assert found["PA-MPJPE, mm, upright"] == pytest.approx(0, abs=1e-6)
    assert "PA-MPJPE, mm, on floor, seat or bent" not in found
    assert found["size of bodies off, %"] == pytest.approx(10)
    assert found["floor: angle, degrees"] == pytest.approx(0)
    assert found["camera height off, %"] == pytest.approx(5)
    assert found["usable people who are wrong, %"] == 0


def test_errors_are_divided_by_the_stated_ones(joints):
    person = person_of(0.9 * joints) | {"distance_sigma": 0.2, "stature_sigma": 0.05}
    answer = answer_with(person, floor=[0, -1, 0, 1.05]) | {"scale_sigma": 0.1}
    found = figures_of(joints, answer)
    error = -math.log(0.9)
    words = "over its stated sigma, rms"
    assert found[f"distance {words}"] == pytest.approx(error / 0.2)
    assert found[f"stature {words}"] == pytest.approx(error / 0.05)
    assert found[f"camera height {words}"] == pytest.approx(math.log(1.05) / 0.1)


def test_up_is_judged_by_its_angle_and_by_its_stated_error_too(joints):
    tilt = math.radians(4)
    up = [0.0, -math.cos(tilt), math.sin(tilt)]
    answer = answer_with(person_of(joints), floor=[0, -1, 0, 1.0]) | {"up": up, "up_sigma": 2.0}
    found = figures_of(joints, answer)
    assert found["up: angle, degrees"] == pytest.approx(4)
    assert found["up over its stated sigma, rms"] == pytest.approx(2**0.5)


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_a_usable_person_a_third_off_is_wrong(joints, scale):
    found = figures_of(joints, answer_with(person_of(scale * joints)))
    assert found["usable people who are wrong, %"] == 100


def test_a_run_writes_table_and_json(tmp_path, monkeypatch, capsys, joints):
    folder = tmp_path / "mpi_inf_3dhp"
    folder.mkdir()
    records = [{**alone(joints).truth, "image": f"{name}.jpg"} for name in ("a", "b")]
    (folder / "truth.json").write_text(json.dumps(records))
    answer = answer_with(person_of(moved(joints, 0, 0, 0.1)))
    monkeypatch.setattr(command, "_answers", lambda samples, _: [answer for _ in samples])
    (tmp_path / "out").mkdir()
    monkeypatch.setattr(sys, "argv", ["truth", str(tmp_path), "--out", str(tmp_path / "out")])
    assert command.main() == 0
    lines = (tmp_path / "out" / "table.md").read_text().splitlines()
    assert "| MPJPE, mm | 100.0 | 100.0 .. 100.0 | 2 |" in lines
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [person["photo"] for person in written["people"]] == ["a", "b"]
    assert "photos: mpi_inf_3dhp 2" in capsys.readouterr().out
    shown = truth_figures(tmp_path / "out" / "results.json")
    assert shown["photos"]["mpi_inf_3dhp"] == 2
    assert {"name": "MPJPE, mm", "value": pytest.approx(100.0)}.items() <= shown["rows"][0].items()
