"""Keypoints: the table has the detected points in px of the photo file, and a run with it finds the
same people.
"""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from physic_core import reconstruct
from physic_core.types import Lens, skeleton_named
from physic_testing.worlds import load_world


def rows_of(file):
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def test_the_table_lists_the_seen_keypoints_in_px_of_the_photo_file(export, result, tmp_path):
    width = result.intrinsics.width
    height = result.intrinsics.height
    export("a.csv", of=replace(result, file_size=(3 * width, 3 * height)))
    rows = rows_of(tmp_path / "a.csv")
    assert list(rows[0]) == ["person", "joint", "x", "y", "confidence"]
    visible = [np.flatnonzero(person.keypoint_confidence) for person in result.people]
    names = skeleton_named(result.skeleton).names
    assert [(int(row["person"]), row["joint"]) for row in rows] == [
        (i, names[j]) for i in (0, 1) for j in visible[i]
    ]
    shown = np.array([(float(row["x"]), float(row["y"])) for row in rows])
    points = np.concatenate(
        [person.keypoints[j] for person, j in zip(result.people, visible, strict=True)]
    )
    assert shown == pytest.approx(3 * points + 1, abs=0.006)


@pytest.mark.usefixtures("few_steps")
@pytest.mark.parametrize(("name", "format"), [("a.csv", None), ("a.json", "coco")])
def test_a_run_with_the_written_keypoints_gives_the_same_bodies(export, tmp_path, name, format):
    world = load_world("stand_indoors", (160, 120))
    config = {"extends": "mock", "run": {"cache": False}}
    first = reconstruct(world.image, config)
    assert first.file_size == (160, 120)
    export(name, format, of=first)
    again = reconstruct(world.image, config | {"photo": {"keypoints": str(tmp_path / name)}})
    assert any("they change nothing" in note for note in again.notes)
    assert np.array_equal(again.people[0].joints, first.people[0].joints)


def test_keypoints_of_an_undistorted_photo_are_those_of_its_file(export, result, tmp_path):
    lens = Lens(result.intrinsics, (0.1, 0.0, 0.0, 0.0, 0.0))
    export("a.csv", of=replace(result, lens=lens))
    row = rows_of(tmp_path / "a.csv")[0]
    person = result.people[0]
    first = person.keypoints[np.flatnonzero(person.keypoint_confidence)[0]]
    expected = lens.file_pixels(first, result.intrinsics)
    assert [float(row["x"]), float(row["y"])] == pytest.approx(expected.tolist(), abs=0.006)
