"""Wrong folders, missing frames and damaged results: each is named, counted or refused, and nothing
is skipped.
"""

from __future__ import annotations

import numpy as np
import pytest

from physic_bench.scoring import LIMB_JOINTS

from .miniatures import TRUE, evaluated, write_plain, write_results

JOINTS = np.array(LIMB_JOINTS)
ONE = TRUE["stand"][None]


def test_results_of_another_data_set_are_refused(root):
    folder = root.parent / "other"
    write_plain(folder, "vicon_1/s1", joints=ONE, joint_names=JOINTS)
    text = evaluated(root, f"other=plain:{folder}", fails=True)
    assert f"{folder} has no result" in text
    assert "expects FRAME.npz" in text


def test_an_unknown_reader_is_refused(root):
    text = evaluated(root, f"other=plian:{root}", fails=True)
    assert text.startswith("no reader is named 'plian': choose one of physic, plain")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"joint_names": JOINTS[:5]}, "joint_names"),
        ({"contact": np.zeros((2, 9))}, "first axes"),
        ({"vertices": np.full((1, 9, 3), np.nan)}, "vertices"),
        ({"vertices": np.array([[{}]])}, "Python objects"),
    ],
)
def test_a_damaged_result_costs_its_frame(root, change, reason):
    theirs = write_results(root)
    arrays = {"joints": ONE, "joint_names": JOINTS, **change}
    write_plain(root.parent / "theirs", "stand", **arrays)
    values = evaluated(root, theirs)
    text = (root.parent / "out" / "table.txt").read_text()
    file = root.parent / "theirs" / "stand.npz"
    assert f"theirs: 1 of 3 frames without a result: stand ({file}" in text
    assert reason in text
    assert values["me_mpjpe"] == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "is_link"),
    [("table.txt", True), ("results.json", False)],
)
def test_a_file_of_the_user_is_never_replaced(root, name, is_link):
    path = root.parent / "out" / name
    victim = root.parent / "victim"
    path.parent.mkdir(parents=True)
    victim.write_text("mine")
    path.symlink_to(victim) if is_link else path.write_text("mine")
    assert f"cannot write {path}" in evaluated(root, write_results(root), fails=True)
    assert path.read_text() == victim.read_text() == "mine"
    assert [file for file in (root.parent / "out").rglob("*") if not file.is_dir()] == [path]


def test_files_of_an_earlier_evaluation_are_replaced(root):
    first = evaluated(root, write_results(root))
    again = write_results(root, move=lambda points: points + np.array([0.05, 0, 0]))
    assert evaluated(root, again) != first
