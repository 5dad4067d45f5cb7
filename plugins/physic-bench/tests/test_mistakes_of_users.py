"""Wrong folders, missing frames and damaged results: each is named, counted or refused, and nothing
is skipped.
"""

from __future__ import annotations

import json
import os

import numpy as np
import pytest

from physic_bench.joints import LIMB_JOINTS

from .miniatures import TRUE, figures, run, write_measured_photos, write_plain

NAMES = np.array(LIMB_JOINTS)


@pytest.fixture
def root(tmp_path):
    """Three photos with one measured person each."""
    return write_measured_photos(tmp_path / "mine")


def results(root, name, frames=(0, 1, 2), shift=0.0):
    for i in frames:
        write_plain(
            root.parent / name, f"p{i}", joints=TRUE[None] + [shift, 0, 0], joint_names=NAMES
        )
    return f"{name}=plain:{root.parent / name}"


def call(root, *theirs, fails=False):
    """Evaluate, and return the text of the table, or the error."""
    more = [part for one in theirs for part in ("--results", one)]
    done = run("calibrated", str(root), "-o", str(root.parent / "out"), *more)
    assert (done.exit_code != 0) == fails, done.output
    if fails:
        return done.output.partition("Error: ")[2].strip()
    return (root.parent / "out" / "table.txt").read_text()


def test_results_of_another_data_set_are_refused(root):
    write_plain(root.parent / "other", "vicon_1/s1", joints=TRUE[None], joint_names=NAMES)
    folder = root.parent / "other"
    text = call(root, f"other=plain:{folder}", fails=True)
    assert f"{folder} has no result" in text
    assert "expects FRAME.npz" in text


def test_an_unknown_reader_is_refused(root):
    text = call(root, f"other=plian:{root}", fails=True)
    assert text.startswith("no reader is named 'plian': choose one of physic, plain")


@pytest.mark.skipif(os.name != "posix", reason="elsewhere no file has such a name")
def test_a_name_of_a_photo_does_not_control_the_terminal(root):
    name = "p\x1b]0;OWNED\x07"
    (root / "p0.png").rename(root / f"{name}.png")
    truth = (root / "truth.json").read_text()
    (root / "truth.json").write_text(truth.replace('"p0.png"', json.dumps(f"{name}.png")))
    done = run(
        "calibrated",
        str(root),
        "-o",
        str(root.parent / "out"),
        "--results",
        results(root, "one", (1, 2)),
    )
    assert r"p\x1b]0;OWNED\x07 (no result)" in done.output
    assert all(c.isprintable() or c in "\n\t" for c in done.output), ascii(done.output)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda a: a.update(K=np.full((3, 3), np.nan)), "K"),
        (lambda a: a.update(contact=np.full((1, 9), np.nan)), "contact"),
        (lambda a: a.update(joint_names=NAMES[:5]), "joint_names"),
        (lambda a: a.update(contact=np.zeros((2, 9))), "first axes"),
        (lambda a: a.update(joints=np.array([["a"]])), "could not convert"),
        (lambda a: a.update(vertices=np.full((1, 9, 3), np.nan)), "vertices"),
        (lambda a: a.update(vertices=np.array([[{}]])), "Python objects"),
    ],
)
def test_a_damaged_result_costs_its_frame(root, change, reason):
    theirs = results(root, "theirs")
    arrays = {"joints": TRUE[None], "joint_names": NAMES}
    change(arrays)
    write_plain(root.parent / "theirs", "p1", **arrays)
    text = call(root, theirs)
    file = root.parent / "theirs" / "p1.npz"
    assert f"theirs: 1 of 3 frames without a result: p1 ({file}" in text
    assert reason in text
    assert figures(root.parent / "out", "theirs")["me_mpjpe"] == pytest.approx(0, abs=1e-9)


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
    assert f"cannot write {path}" in call(root, results(root, "theirs"), fails=True)
    assert path.read_text() == victim.read_text() == "mine"
    assert [file for file in (root.parent / "out").rglob("*") if not file.is_dir()] == [path]


def test_files_of_an_earlier_evaluation_are_replaced(root):
    first = call(root, results(root, "theirs"))
    assert call(root, results(root, "theirs", shift=0.05)) != first


def test_options_that_change_figures_stand_over_the_tables(root):
    theirs = results(root, "theirs")
    assert call(root, theirs).startswith("calibrated, 3 frames\n\n")
    done = run(
        "calibrated", str(root), "-o", str(root.parent / "out"), "--results", theirs, "--limit", "2"
    )
    assert "calibrated, 2 frames, with --limit 2\n" in done.output
    (root.parent / "list.txt").write_text("p0\ngone\n")
    more = ("--results", theirs, "--frames", str(root.parent / "list.txt"))
    assert (
        "frames that there are not: gone" in run("calibrated", str(root), "-o", "out", *more).output
    )
