"""Keypoints that the user gives in a file: COCO JSON or CSV replaces what the detector found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physic_core import InputError, reconstruct
from physic_core.io.keypoint_file import read_keypoints
from physic_core.pipeline.known_people import corrected_keypoints
from physic_core.types import SKELETONS, Keypoints
from physic_testing.worlds import World, build_world

pytestmark = pytest.mark.usefixtures("few_steps")

NAMES = SKELETONS["coco17"].names
LEFT_WRIST, LEFT_ELBOW = NAMES.index("left_wrist"), NAMES.index("left_elbow")


def run(world: World, file: Path):
    config = {"extends": "mock", "run": {"cache": False}, "photo": {"keypoints": str(file)}}
    config["keypoint_detector"] = {"options": {"skeleton": "coco17"}}
    return reconstruct(world.image, config)


def written(folder: Path, text: str, name: str = "keypoints.csv") -> Path:
    file = folder / name
    file.write_text(text)
    return file


def detected(world: World, folder: Path):
    """The result with a keypoint of the corner, of no weight for the others."""
    return run(world, written(folder, "person,joint,x,y\n0,left_ear,0,0\n"))


def test_a_csv_file_moves_one_joint_and_leaves_the_others(tmp_path: Path, world: World) -> None:
    before = detected(world, tmp_path)
    found = run(world, written(tmp_path, "person, joint, x, y\n0, left_wrist, 40, 30.5\n0, left_ear, 0, 0\n"))
    (one,), (other,) = found.people, before.people
    assert one.keypoints[LEFT_WRIST].tolist() == [40, 30.5]
    assert one.keypoint_confidence[LEFT_WRIST] == 1
    assert any("given keypoints: 2" in note for note in found.notes)
    rest = np.arange(len(NAMES)) != LEFT_WRIST
    assert np.array_equal(one.keypoints[rest], other.keypoints[rest])
    assert np.linalg.norm(one.joints - other.joints, axis=1).max() > 0.02


def test_annotations_of_coco_are_matched_to_people_by_their_keypoints(tmp_path: Path) -> None:
    world = build_world("child_by_the_hand", 1, (160, 120))
    before = detected(world, tmp_path)
    last = before.people[-1]
    shown = np.concatenate([last.keypoints + 1, np.full((17, 1), 2.0)], 1)
    shown[LEFT_ELBOW] = 0
    annotation = {"image_id": 7, "category_id": 1, "keypoints": shown.ravel().tolist()}
    (tmp_path / "coco.json").write_text(json.dumps({"annotations": [annotation]}))
    found = run(world, tmp_path / "coco.json").people[-1].keypoints
    given = np.arange(17) != LEFT_ELBOW
    assert found[given] == pytest.approx(shown[given, :2])
    assert found[LEFT_ELBOW] == pytest.approx(last.keypoints[LEFT_ELBOW])


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("joint,x,y\nleft_wrist,1,2\n", "a.csv", "lacks person"),
        ("person,joint,x,y\n0,left_wrist,1\n", "a.csv", "line 2"),
        ("person,joint,x,y\n", "a.csv", "no keypoints"),
        ("person,joint,x,y\n0,left_wrist,900,2\n", "a.csv", "160 x 120 px"),
        ("person,joint,x,y\n0,left_wrist,1,2\n0,left_wrist,1,3\n", "a.csv", "twice"),
        ("{", "a.json", "COCO JSON"),
        ("{}", "a.json", "no list of annotations"),
        ('[{"image_id": 1, "keypoints": [1, 2]}]', "a.json", "2 numbers for 17 keypoints"),
        ('[{"image_id": 1}, {"image_id": 2}]', "a.json", "2 images"),
    ],
)
def test_a_bad_file_is_refused_with_its_path_and_what_is_wrong(tmp_path: Path, text: str, name: str, said: str) -> None:
    file = written(tmp_path, text, name)
    with pytest.raises(InputError) as caught:
        read_keypoints(str(file), 160, 120)
    assert said in str(caught.value)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(("row", "said"), [("3,nose", "1 people were found"), ("0,left_flipper", "right_ankle")])
def test_a_person_or_joint_that_is_not_there_is_refused(tmp_path: Path, world: World, row: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(world, written(tmp_path, f"person,joint,x,y\n{row},5,5\n"))


def test_a_corrected_joint_loses_its_3d_point_and_takes_its_hand_along(tmp_path: Path) -> None:
    names = SKELETONS["blazepose33"].names
    points = np.arange(2 * 33 * 2, dtype=float).reshape(2, 33, 2)
    before = Keypoints(points, np.full((2, 33), 0.5), "blazepose33", np.zeros((2, 33, 3)))
    file = written(tmp_path, "person,joint,x,y\n1,left_wrist,7,8\n1,left_eye,3,4\n")
    after = corrected_keypoints(before, read_keypoints(str(file), 160, 120))
    moved = {name for row, name in enumerate(names) if (after.points[1, row] != points[1, row]).any()}
    assert moved == {"left_wrist", "left_pinky1", "left_index1", "left_thumb2", "left_eye_surface"}
    assert after.world is not None
    assert {names[row] for row in np.flatnonzero(np.isnan(after.world[1]).any(1))} == moved
    wrist, thumb = names.index("left_wrist"), names.index("left_thumb2")
    assert (after.points[1, thumb] - after.points[1, wrist]).tolist() == (points[1, thumb] - points[1, wrist]).tolist()
    assert np.array_equal(after.points[0], points[0])
    assert after.confidence[1].max() == after.confidence[1, wrist] == 1
    assert before.points[1, wrist].tolist() == points[1, wrist].tolist()
