"""``benchmarks truth --against``: a known difference comes out with its verdict, what one build
does not state is not measured, and answers of an earlier comparison are taken again.
"""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.truth import against, builds, layouts, pairs, sets
from benchmarks.truth.joints import BODY_ROWS, limb_joints
from benchmarks.truth.pairs import Figure, Pair, Verdict
from physic_bench.scoring import LIMB_JOINTS
from tests.benchmarks.test_truth import STANDING

PACKAGE = """
from types import SimpleNamespace as Record

import numpy as np


class types:
    skeleton_named = staticmethod(lambda name: Record(names=("nose",)))


import sys

sys.modules["physic_core.types"] = types


def load_config(*, preset, overrides):
    return preset


class Pipeline:
    def __init__(self, config):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __call__(self, photo, settings):
        joints = np.array(JOINTS) * SCALE
        person = Record(
            box=np.array([35, 19, 65, 75]),
            mask=np.ones((80, 100), bool),
            joints=joints,
            keypoints=np.full((1, 2), 5.0),
            keypoint_confidence=np.ones(1),
            **MORE,
        )
        camera = Record(fx=100.0, fy=100.0, cx=50.0, cy=40.0, width=100, height=80)
        floor = Record(normal=np.array([0.0, -1, 0]), offset=1.0)
        scene = Record(floor=floor, points=np.ones((8, 10, 3)), valid=np.ones((8, 10), bool))
        return Record(
            people=[person],
            scene=scene,
            intrinsics=camera,
            skeleton="one",
            warnings=WARNINGS,
            distance_sigmas=[None],
            distance_sigma=None,
        )
"""


def body_joints():
    joints = limb_joints(STANDING, 3)
    body = np.zeros((55, 3))
    body[0] = 0.0, 0.0, 3.0
    body[BODY_ROWS] = joints
    return body, joints


def checkout(folder, scale=1.0, warnings=(), **more):
    """A build of its own: a repository with a package, and an interpreter that imports it."""
    code = folder / "physic_core" / "__init__.py"
    code.parent.mkdir(parents=True)
    names = {"JOINTS": body_joints()[0].tolist(), "SCALE": scale}
    names |= {"WARNINGS": tuple(warnings), "MORE": more}
    code.write_text(PACKAGE + "\n".join(f"{name} = {value!r}" for name, value in names.items()))
    python = folder / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nPYTHONPATH={folder} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    (folder / ".gitignore").write_text(".venv\n")
    for words in (
        ["init", "-q"],
        ["add", "."],
        ["-c", "user.name=a", "-c", "user.email=a@b.c", "commit", "-qm", "all"],
    ):
        subprocess.run(["git", "-C", str(folder), *words], check=True)
    return builds.build_of(folder, "embedded")


def plan():
    """One photo with truth, one with labels that is changed, and a file of two photos."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 255, (800, 1000, 3), np.uint8)
    K = np.array([[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]])
    facts = {
        "joints": dict(zip(LIMB_JOINTS, body_joints()[1].tolist(), strict=True)),
        "K": K.tolist(),
        "up": [0.0, -1.0, 0.0],
        "floor_point": [0.3, 1.0, 2.0],
    }
    measured = sets.Sample("mpi_inf_3dhp", "one", "one", Path("one.jpg"), K=K, truth=facts)
    person = {"box": [350, 190, 650, 750], "parts": {"left_foot": "floor", "left_hand": "none"}}
    labelled = sets.Sample("contact", "two", "two", Path("two.jpg"), truth={"people": [person]})
    mirror = next(one for one in against.VARIANTS if one.name == "mirror")
    question = builds.Question
    return against.Plan(
        [against.Case(measured, question("one", picture, (1000.0, 1000.0, 500.0, 400.0)))],
        [against.Case(labelled, question("two", picture[::-1]))],
        [(0, mirror, question("two mirror", picture[:, ::-1]))],
        [question("file", layouts.STRIPS[0].picture([picture, picture]))],
    )


def pair(number, other, this):
    return Pair("a", str(number), str(number), other, this)


def verdict(differences, other=100.0):
    figure = Figure("", [pair(i, other, other + d) for i, d in enumerate(differences)])
    return pairs.compare(figure).verdict


def test_a_verdict_needs_the_limit_and_the_whole_interval():
    assert verdict([8, 9, 10, 11]) is Verdict.WORSE
    assert verdict([2, 3, 3, 4]) is Verdict.KEPT  # within 5 %
    assert verdict([-60, 80, -30, 50]) is Verdict.CANNOT_TELL
    assert verdict([-1, 1, -1, 1]) is Verdict.KEPT
    assert verdict([-8, -9, -10]) is Verdict.BETTER
    assert verdict([0, 0, 0]) is Verdict.KEPT
    assert verdict([50]) is Verdict.CANNOT_TELL  # of one person there is no interval
    assert verdict([]) is Verdict.NOT_MEASURED


def test_what_one_build_does_not_state_is_in_no_pair():
    before = [{"set": "a", "photo": "p", "person": "0", "x": 1.0}]
    after = [{"set": "a", "photo": "p", "person": "0", "x": math.nan}]
    assert pairs.paired("x", before, after) == []
    assert pairs.paired("y", before, before) == []
    assert pairs.paired("x", before, before)[0].this == 1.0


def test_two_builds_differ_by_what_differs_in_them(tmp_path):
    words = ("two pictures: cut them apart, and run each",)
    touch = {"left_foot": 0.9, "left_hand": 0.1}
    old = checkout(tmp_path / "old", 1.0, words, trust_place=0.9, world_contact=touch)
    new = checkout(tmp_path / "new", 1.1, (), trust_place=0.9)
    one = plan()
    found = against.both_answers((old, new), one.questions, tmp_path / "out")
    rows = {row.figure.name: row for row in against.rows_of(one, *found)}
    mpjpe = rows["MPJPE, mm"]
    assert mpjpe.other == pytest.approx(0, abs=1e-6)
    distances = np.linalg.norm(body_joints()[1], axis=-1)
    assert mpjpe.this == pytest.approx(100 * distances.mean(), rel=1e-6)
    assert rows["size of bodies off, %"].this == pytest.approx(10)
    assert rows["camera height off, %"].verdict is Verdict.KEPT
    assert rows["labelled touch, Brier score: feet"].verdict is Verdict.NOT_MEASURED
    files = rows["several pictures in a file: not detected, %"]
    assert (files.other, files.this) == (0, 100)
    single = rows["one photo taken for several pictures, %"]
    assert (single.other, single.this) == (100, 0)
    assert rows["same photo, changed: distance, %, median"].this == pytest.approx(0)
    assert "| not measured |" in pairs.page(list(rows.values()), "new against old")

    (tmp_path / "old" / ".venv" / "bin" / "python").write_text("#!/bin/sh\nexit 3\n")
    again = against.both_answers((old, new), one.questions, tmp_path / "out")
    assert [answer.record["error"] for answer in again[0]] == [""] * 4


def test_a_build_that_ends_is_no_answer(tmp_path):
    build = checkout(tmp_path / "old")
    (tmp_path / "old" / ".venv" / "bin" / "python").write_text("#!/bin/sh\nexit 3\n")
    with (
        pytest.raises(SystemExit, match="ended with 3"),
        builds.asked(build, tmp_path / "out") as ask,
    ):
        ask(plan().questions[0])
