"""``physic evaluate calibrated``: errors that are put in by hand come out as those numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from physic_bench.joints import LIMB_JOINTS

from .miniatures import SIZE, TRUE, K, figures, run, write_measured_photos, write_plain

HIPS_Z = TRUE[[LIMB_JOINTS.index(f"{side}_hip") for side in ("left", "right")], 2].mean()
SWAPPED = TRUE.reshape(6, 2, 3)[:, ::-1].reshape(12, 3)


def moved(points, x, y, z):
    return points + np.array([x, y, z])


@pytest.fixture
def root(tmp_path):
    """Three photos with one measured person each."""
    folder = write_measured_photos(tmp_path / "mine")
    records = json.loads((folder / "truth.json").read_text())
    for i, record in enumerate(records):
        record["joints"] = {
            name.replace("left_", "l_"): place for name, place in record["joints"].items()
        }
        record |= {
            "up": [0, -1, 0],
            "floor_point": [0, 1.0, 3],
            "sequence": f"s{i % 2}",
            "action": "standing",
        }
    (folder / "truth.json").write_text(json.dumps(records))
    return folder


def results(tmp_path, joints, name="theirs", **more):
    for i in range(3):
        write_plain(
            tmp_path / name, f"p{i}", joints=joints[None], joint_names=np.array(LIMB_JOINTS), **more
        )
    return f"{name}=plain:{tmp_path / name}"


def evaluated(root, out, *arguments):
    done = run("calibrated", str(root), "-o", str(out), *arguments)
    assert done.exit_code == 0, done.output
    return figures(out, "theirs")


def test_a_shift_of_5_cm_has_an_error_of_5_cm(root, tmp_path):
    found = evaluated(
        root, tmp_path / "out", "--results", results(tmp_path, moved(TRUE, 0.03, 0, 0.04))
    )
    assert found == {
        "found": 1.0,
        "me_mpjpe": pytest.approx(50),
        "ca_mpjpe": pytest.approx(0, abs=1e-6),
        "pa_mpjpe": pytest.approx(0, abs=1e-6),
        "rt_error": pytest.approx(50),
        "depth_ratio": pytest.approx((HIPS_Z + 0.04) / HIPS_Z),
    }


def test_exchanged_sides_are_the_distance_between_them(root, tmp_path):
    found = evaluated(root, tmp_path / "out", "--results", results(tmp_path, SWAPPED))
    apart = 1000 * np.linalg.norm(SWAPPED - TRUE, axis=1).mean()
    assert (found["me_mpjpe"], found["ca_mpjpe"]) == (pytest.approx(apart), pytest.approx(apart))
    assert found["rt_error"] == pytest.approx(0, abs=1e-9)


def test_floor_and_height_of_the_camera(root, tmp_path):
    tilt = np.radians(2)
    floor = np.array([np.sin(tilt), -np.cos(tilt), 0, 1.1])
    found = evaluated(root, tmp_path / "out", "--results", results(tmp_path, TRUE, floor=floor))
    assert (found["floor_angle_deg"], found["camera_height_ratio"]) == (
        pytest.approx(2),
        pytest.approx(1.1),
    )


def test_methods_are_compared_in_pairs_and_written_as_tables(root, tmp_path):
    one = results(tmp_path, moved(TRUE, 0.02, 0, 0), "one")
    two = results(tmp_path, moved(TRUE, 0.05, 0, 0), "two")
    (tmp_path / "two" / "p2.npz").unlink()
    out = tmp_path / "out"
    done = run("calibrated", str(root), "-o", str(out), "--results", one, "--results", two)
    assert done.exit_code == 0, done.output
    document = json.loads((out / "results.json").read_text())
    assert document["differences"]["two"]["me_mpjpe"]["value"] == pytest.approx(30)
    assert document["differences"]["two"]["me_mpjpe"]["count"] == 2
    assert figures(out, "two")["found"] == pytest.approx(2 / 3)
    missing = [r for r in document["records"]["two"] if not r["found"]]
    assert [(r["frame"], r["reason"]) for r in missing] == [("p2", "no result")]
    text = (out / "table.txt").read_text()
    assert "two: 1 of 3 frames without a result: p2 (no result)\n" in text
    assert "Difference from one" in text
    assert "| MPJPE, mm |" in (out / "table.md").read_text()


@pytest.mark.parametrize(
    "move", [lambda p: p * [1, -1, -1], lambda p: moved(p, 9, 0, 0)], ids=["y up", "other picture"]
)
def test_results_in_another_frame_of_reference_are_refused(root, tmp_path, move):
    done = run(
        "calibrated",
        str(root),
        "-o",
        str(tmp_path / "out"),
        "--results",
        results(tmp_path, move(TRUE)),
    )
    assert done.exit_code != 0
    assert "do not project onto the annotated people" in done.output


def test_faults_of_the_truth_are_named(root, tmp_path):
    arguments = ("calibrated", str(root), "-o", str(tmp_path / "out"), "--preset", "mock")
    (root / "p1.png").unlink()
    assert f"{root / 'p1.png'}: the photo is not there" in run(*arguments).output
    records = json.loads((root / "truth.json").read_text())
    del records[0]["K"]
    records.pop(1)
    (root / "truth.json").write_text(json.dumps(records))
    assert f"{root / 'truth.json'} cannot be read: KeyError: 'K'" in run(*arguments).output
    assert not (tmp_path / "out" / "table.txt").exists()


VIEWS = ("east", "north", "west", "south")


@pytest.fixture
def views(tmp_path):
    """Four cameras round two people; z is up in the world."""
    folder = tmp_path / "views"
    folder.mkdir()
    cameras = {}
    for k, name in enumerate(VIEWS):
        angle = np.pi / 2 * k + 0.3
        forward = np.array([-np.cos(angle), -np.sin(angle), 0])
        right = np.array([forward[1], -forward[0], 0])
        R = np.stack([right, [0, 0, -1], forward])
        t = -R @ np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.5])
        cameras[name] = {
            "width": 640,
            "height": 480,
            "K": (K * [[0.8], [0.8], [1]]).tolist(),
            "dist": [0] * 5,
        }
        cameras[name] |= {"R": R.tolist(), "t_m": t.tolist()}
        Image.new("RGB", SIZE, (90, 90, 90)).save(folder / f"{name}_0.png")
    (folder / "cameras.json").write_text(json.dumps({"cameras": cameras, "up": [0, 0, 1]}))
    return folder


def people_of_views():
    upright = (TRUE - [0, 0.9, 3]) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).T
    return [upright, moved(upright, -0.8, 0.9, 0)]


def written_views(views, tmp_path, shift):
    from physic_bench.cameras import calibrated

    document = json.loads((views / "cameras.json").read_text())
    for name in VIEWS:
        camera, _ = calibrated(document["cameras"][name])
        joints = np.stack(
            [
                camera.in_camera(person + shift.get(name, np.zeros(3)))
                for person in people_of_views()
            ]
        )
        keypoints = np.stack([camera.project(person) for person in people_of_views()])
        write_plain(
            tmp_path / "theirs",
            f"{name}_0",
            joints=joints,
            joint_names=np.array(LIMB_JOINTS),
            keypoints=keypoints,
        )
    return f"theirs=plain:{tmp_path / 'theirs'}"


def test_views_are_triangulated_and_their_spread_is_measured(views, tmp_path):
    theirs = written_views(views, tmp_path, {"east": np.array([0, 0, 0.08])})
    found = evaluated(views, tmp_path / "out", "--results", theirs)
    assert found["me_mpjpe"] == pytest.approx(80 / 4, abs=0.1)
    assert found["spread_mm"] == pytest.approx(1000 * np.std([0.08, 0, 0, 0]), abs=0.1)
    text = (tmp_path / "out" / "table.txt").read_text()
    assert "2 people are triangulated" in text


def test_measured_joints_of_the_world_are_the_truth_of_all_views(views, tmp_path):
    people = [dict(zip(LIMB_JOINTS, person.tolist(), strict=True)) for person in people_of_views()]
    (views / "joints.json").write_text(json.dumps({"0": people}))
    found = evaluated(views, tmp_path / "out", "--results", written_views(views, tmp_path, {}))
    assert found["me_mpjpe"] == pytest.approx(0, abs=1e-6)
