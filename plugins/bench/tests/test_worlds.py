"""``physic evaluate worlds``: errors put in by hand come out as those numbers, and pictures go
through the batch.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from physic_bench.bodies import BodyFiles
from physic_bench.datasets.worlds import frames
from physic_bench.evaluation import Method, evaluate_methods
from physic_core.errors import OutputError
from physic_testing.worlds import load_world

from .miniatures import NAMES, evaluated, figures, run, write_results


def by(*offset):
    return lambda points: points + np.array(offset)


def test_floor_and_height_of_the_camera(root):
    for name in NAMES:
        floor = load_world(name).floor
        across = np.cross(floor.normal, [1, 0, 0])
        across /= np.linalg.norm(across)
        tilted = np.cos(np.radians(2)) * floor.normal + np.sin(np.radians(2)) * across
        theirs = write_results(root, (name,), floor=np.array([*tilted, 1.1 * floor.offset]))
    values = evaluated(root, theirs)
    assert values["depth_ratio"] == pytest.approx(1)
    assert values["floor_angle_deg"] == pytest.approx(2, abs=1e-3)
    assert values["camera_height_ratio"] == pytest.approx(1.1)


def test_methods_are_compared_in_pairs_and_written_as_tables(root):
    one = write_results(root, name="one", move=by(0.02, 0, 0))
    two = write_results(root, name="two", move=by(0.05, 0, 0))
    (root.parent / "two" / f"{NAMES[2]}.npz").unlink()
    evaluated(root, one, two)
    out = root.parent / "out"
    document = json.loads((out / "results.json").read_text())
    change = document["differences"]["two"]["me_mpjpe"]
    assert (change["value"], change["count"]) == pytest.approx((30, 2))
    assert figures(out, "two")["found"] == pytest.approx(2 / 3)
    missing = [r for r in document["records"]["two"] if not r["found"]]
    assert [(r["frame"], r["reason"]) for r in missing] == [(NAMES[2], "no result")]
    text = (out / "table.txt").read_text()
    assert f"two: 1 of 3 frames without a result: {NAMES[2]} (no result)\n" in text
    assert "| MPJPE, mm |" in (out / "table.md").read_text()


@pytest.mark.parametrize(
    "move", [lambda p: p * [1, -1, -1], by(9, 0, 0)], ids=["y up", "other picture"]
)
def test_results_in_another_frame_of_reference_are_refused(root, move):
    text = evaluated(root, write_results(root, move=move), fails=True)
    assert "do not project onto the annotated people" in text


def test_the_truth_is_perfect_and_touches_its_scene(tmp_path):
    """Two people who hug, in an order of its own."""
    world = load_world("hug")
    order = [1, 0]
    arrays = {name: getattr(world, name)[order] for name in ("vertices", "joints", "contact")}
    frame_set = frames(tmp_path, lambda names: ["hug"], BodyFiles())
    (frame,) = frame_set.frames
    names = np.array(frame.truth().people[0].joint_names)
    np.savez(tmp_path / "hug.npz", joint_names=names, K=world.intrinsics.matrix, **arrays)
    records, _ = evaluate_methods(frame_set, [Method("true", "plain", tmp_path)], BodyFiles())
    for record in records["true"]:
        assert record["found"]
        assert record["me_mpjpe"] == record["me_pve"] == 0
        assert record["focal_ratio"] == 1
        assert record["contact"]["annotated"]["hits"] > 0
        assert record["contact"]["annotated"]["false_alarms"] == 0
        assert record["floating_mm"] < 20
        assert record["penetration_mm"] < 20


@pytest.mark.parametrize(
    "name", ["out/reconstructions", "out/reconstructions/logs", "out/reconstructions/pictures"]
)
def test_nothing_is_written_through_a_link_of_the_user(name, root):
    outside = root.parent / "outside"
    outside.mkdir()
    (root.parent / name).parent.mkdir(parents=True)
    (root.parent / name).symlink_to(outside)
    done = run("worlds", str(root), "-o", str(root.parent / "out"), "--preset", "mock")
    assert (done.exit_code, [*outside.iterdir()]) == (2, [])


def test_another_picture_is_not_taken_for_that_of_a_world(root):
    root.mkdir(exist_ok=True)
    Image.new("RGB", (320, 240)).save(root / "walk.png")
    with pytest.raises(OutputError, match="did not write"):
        frames(root, lambda names: ["walk"], BodyFiles())
