"""Keypoints that the user gives in a file: COCO JSON or CSV replaces what the detector found."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from physic_core import InputError, reconstruct
from physic_core.configuration.model import PhotoSettings
from physic_core.io.keypoint_file import read_keypoints
from physic_core.io.photo import read_photo
from physic_core.prepare.keypoints import contradicted_keypoints, corrected_keypoints
from physic_core.prepare.photo import prepare_photo
from physic_core.types import SKELETONS, Keypoints, People
from physic_core.types.skeletons import mirrored_order
from physic_mock import backends

pytestmark = pytest.mark.usefixtures("few_steps")

NAMES = SKELETONS["coco17"].names
LEFT_WRIST = NAMES.index("left_wrist")
LEFT_ELBOW = NAMES.index("left_elbow")


def run(world, file):
    config = {"extends": "mock", "run": {"cache": False}, "photo": {"keypoints": str(file)}}
    config["keypoint_detector"] = {"options": {"skeleton": "coco17"}}
    return reconstruct(world.image, config)


def written(folder, text, name="keypoints.csv"):
    file = folder / name
    file.write_text(text)
    return file


def test_a_csv_file_moves_one_joint_and_leaves_the_others(tmp_path, world):
    corner = "person, joint, x, y\n0, left_ear, 0, 0\n"  # of no weight for the others
    (other,) = run(world, written(tmp_path, corner)).people
    found = run(world, written(tmp_path, f"{corner}0, left_wrist, 40, 30.5\n"))
    (one,) = found.people
    assert one.keypoints[LEFT_WRIST].tolist() == [40, 30.5]
    assert one.keypoint_confidence[LEFT_WRIST] == 1
    assert any("given keypoints: 2" in note for note in found.notes)
    rest = np.arange(len(NAMES)) != LEFT_WRIST
    assert np.array_equal(one.keypoints[rest], other.keypoints[rest])
    assert np.linalg.norm(one.joints - other.joints, axis=1).max() > 0.02


class Fronts(backends.MockKeypointDetector):
    """It takes the back of the world's person for a front."""

    def infer(self, image, people):
        found = super().infer(image, people).mirrored_in_depth(np.array([True]))
        return replace(found, world=np.pad(found.points / 100, ((0, 0), (0, 0), (0, 1))))


class SeenFromBehind(backends.MockPersonObserver):
    def infer(self, *arguments):
        return replace(super().infer(*arguments), away=np.array([0.99], np.float32), away_share=0.1)


@pytest.mark.parametrize("given", [False, True])
def test_sides_of_a_back_that_looks_like_a_front_change_places_but_not_those_given(
    tmp_path, world, given
):
    config = {"extends": "mock", "run": {"cache": False}}
    config["keypoint_detector"] = {"options": {"skeleton": "coco17"}}
    if given:
        config["photo"] = {"keypoints": str(written(tmp_path, "person,joint,x,y\n0,nose,80,20\n"))}
    seen = {"keypoint_detector": Fronts}
    before, after = (
        reconstruct(world.image, config, backends=seen | more).people[0].keypoints
        for more in ({}, {"person_observer": SeenFromBehind})
    )
    left, right = (NAMES.index(f"{side}_knee") for side in ("left", "right"))
    assert before[left, 0] > before[right, 0]
    assert np.array_equal(after[left], before[left if given else right])


def test_a_wrist_that_no_arm_reaches_is_contradicted_by_the_photo(tmp_path, world):
    found = run(world, written(tmp_path, "person,joint,x,y\n0,left_wrist,2,110\n"))
    off_body, off_photo = (text for text in found.warnings if "your left wrist" in text)
    assert "from the place" in off_body
    assert "from the mask" in off_photo
    assert {"given_keypoints", "contradicted_keypoints"} <= set(found.people[0].failed_checks)
    assert "pose" not in found.people[0].usable


@pytest.mark.parametrize(("at", "apart_px"), [((90, 190), 0), ((90, 60), 130)])
def test_a_joint_where_the_detector_found_that_of_the_other_side_is_not_contradicted(at, apart_px):
    points = np.full((1, 17, 2), 50.0)
    points[0, [NAMES.index("left_ankle"), NAMES.index("right_ankle")]] = (10, 190), (90, 190)
    found = Keypoints(points, np.full((1, 17), 0.9), "coco17")
    changed = np.zeros((1, 17), bool)
    changed[0, NAMES.index("left_ankle")] = True
    given = replace(found, points=np.where(changed[..., None], np.array(at, float), points))
    boxes = np.array([[0, 0, 100, 200]], float)
    people = People(np.ones((1, 200, 100), bool), boxes, np.ones(1))
    off = contradicted_keypoints(found, given, changed, people)
    assert off.max() == pytest.approx(apart_px)


def annotation(points, hidden=None):
    """An annotation of COCO with 17 points (17, 2), of which one is not marked."""
    shown = np.concatenate([points, np.full((17, 1), 2.0)], 1)
    if hidden is not None:
        shown[hidden] = 0
    return {"image_id": 7, "category_id": 1, "keypoints": shown.ravel().tolist()}


def two_people():
    """A person in the left half of a picture, and one behind them, whose box is larger and whose
    mask is smaller.
    """
    points = np.random.default_rng(0).uniform((10, 10), (60, 110), (17, 2))
    points = np.stack([points, np.random.default_rng(1).uniform((5, 5), (150, 115), (17, 2))])
    masks = np.zeros((2, 120, 160), bool)
    masks[0, :, :70] = True
    masks[1, :, 70:] = True
    boxes = np.array([[0, 0, 70, 120], [0, 0, 160, 120]], float)
    return Keypoints(points, np.full((2, 17), 0.9), "coco17"), People(masks, boxes, np.ones(2))


def corrected(folder, annotations, right_px=0):
    """The keypoints of two people with given ones; their boxes are moved to the right."""
    own, people = two_people()
    people = replace(people, boxes=people.boxes + np.array([right_px, 0, 0, 0]))
    file = written(folder, json.dumps({"annotations": annotations}), "coco.json")
    return corrected_keypoints(own, read_keypoints(str(file), 160, 120), people)


def test_an_annotation_is_of_the_person_whose_box_and_mask_hold_its_points(tmp_path):
    before, _ = two_people()
    shown = before.points[1] + 1
    after, changed, notes = corrected(
        tmp_path, [annotation(shown, LEFT_ELBOW), annotation(before.points[0] + 2)]
    )
    assert changed.sum(1).tolist() == [17, 16]
    assert after.points[0] == pytest.approx(before.points[0] + 2)
    given = np.arange(17) != LEFT_ELBOW
    assert after.points[1, given] == pytest.approx(shown[given])
    assert after.points[1, LEFT_ELBOW] == pytest.approx(before.points[1, LEFT_ELBOW])
    assert len(notes) == 1


def test_a_photo_that_is_made_smaller_has_given_scores_and_a_note_in_px_of_its_file(tmp_path):
    file = written(tmp_path, "person,joint,x,y,confidence\n0,left_wrist,200,100,0.4\n")
    keypoints, people = two_people()
    settings = PhotoSettings(keypoints=str(file), max_side=160)
    given = prepare_photo(
        read_photo(np.zeros((240, 320, 3), np.uint8)), settings, None, None
    ).keypoints
    assert given is not None
    keypoints.points[0, LEFT_WRIST] = given.points[0] - [60, 0]
    after, _, (note,) = corrected_keypoints(keypoints, given, people)
    assert after.confidence[0, LEFT_WRIST] == pytest.approx(0.4)
    assert "120 px" in note


@pytest.mark.parametrize(("order", "is_named"), [(mirrored_order(NAMES), True), (range(17), False)])
def test_exchanged_sides_are_named(tmp_path, order, is_named):
    before, _ = two_people()
    *_, note = corrected(tmp_path, [annotation(before.points[1][[*order]] + 1)])[2]
    assert ("left and right" in note) == is_named


def test_annotations_that_are_of_nobody_are_refused(tmp_path):
    with pytest.raises(InputError, match="none of the 2 people"):
        corrected(tmp_path, [annotation(np.full((17, 2), 3.0))], right_px=80)


def test_keypoints_that_are_given_as_they_were_detected_change_nothing(tmp_path):
    before, _ = two_people()
    after, changed, (note,) = corrected(tmp_path, [annotation(before.points[0].round(2))])
    assert not changed.any()
    assert np.array_equal(after.points, before.points)
    assert np.array_equal(after.confidence, before.confidence)
    assert "nothing" in note


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("joint,x,y\nleft_wrist,1,2\n", "a.csv", "lacks person"),
        ("person,joint,x,y\n0,left_wrist,1\n", "a.csv", "row 1"),
        ("person,joint,x,y\n", "a.csv", "no keypoints"),
        ("person,joint,x,y\n0," + "x" * 200_000, "a.csv", "field larger than field limit"),
        ("person,joint,x,y\n0,left_wrist,900,2\n", "a.csv", "160 x 120 px"),
        ('{"imagePath": "a.jpg", "shapes": []}', "a.json", "labelme"),
        ('[{"x": 0.4, "y": 0.5, "z": 0, "visibility": 1}]', "a.json", "MediaPipe"),
        ("person,joint,x,y\n0,nose,.4,.5\n0,left_wrist,.5,.4\n", "a.csv", "shares"),
        ("person,joint,x,y\n0,left_wrist,1,2\n0,left_wrist,1,3\n", "a.csv", "twice"),
        ("{}", "a.json", "format is unknown"),
        ('[{"image_id": 1, "keypoints": [1, 2]}]', "a.json", "2 numbers for 17, 23, 26 or 133"),
    ],
)
def test_a_bad_file_is_refused_with_its_path_and_what_is_wrong(tmp_path, text, name, said):
    file = written(tmp_path, text, name)
    with pytest.raises(InputError) as caught:
        read_keypoints(str(file), 160, 120)
    assert said in str(caught.value)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("row", "said"), [("3,nose", "1 people were found"), ("0,left_flipper", "right_ankle")]
)
def test_a_person_or_joint_that_is_not_there_is_refused(tmp_path, world, row, said):
    with pytest.raises(InputError, match=said):
        run(world, written(tmp_path, f"person,joint,x,y\n{row},5,5\n"))


def test_a_corrected_joint_loses_its_3d_point_and_takes_its_hand_along(tmp_path):
    names = SKELETONS["blazepose33"].names
    points = np.arange(2 * 33 * 2, dtype=float).reshape(2, 33, 2)
    before = Keypoints(points, np.full((2, 33), 0.5), "blazepose33", np.zeros((2, 33, 3)))
    file = written(tmp_path, "person,joint,x,y\n1,left_wrist,7,8\n1,left_eye,3,4\n")
    after, changed, _ = corrected_keypoints(
        before, read_keypoints(str(file), 160, 120), two_people()[1]
    )
    assert changed[1].sum() == 2
    moved = {
        name for row, name in enumerate(names) if (after.points[1, row] != points[1, row]).any()
    }
    assert moved == {"left_wrist", "left_pinky1", "left_index1", "left_thumb2", "left_eye_surface"}
    assert after.world is not None
    assert {names[row] for row in np.flatnonzero(np.isnan(after.world[1]).any(1))} == moved
    assert np.array_equal(after.points[0], points[0])


@pytest.mark.parametrize("name", ["a.csv", "a.json"])
def test_a_file_of_more_than_10_mb_is_not_read(tmp_path, name):
    with (tmp_path / name).open("wb") as file:
        file.truncate(10_000_001)
    with pytest.raises(InputError, match="more than"):
        read_keypoints(str(tmp_path / name), 160, 120)
