"""Keypoints as other programs write them: each file arrives in px, with scores as scores, or is
refused by name.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physic_core.errors import InputError, PackageMissingError
from physic_core.io.keypoint_file import read_keypoints

FILES = Path(__file__).parent / "keypoints"
SLOPE = 720, 1280


def read(name, size=SLOPE, photo=""):
    return read_keypoints(str(FILES / f"{name}.json"), *size, photo)


def place(given, joint):
    points = given.points[[name == joint for name in given.joint]]
    assert len(points) == 1
    return [float(value) for value in points[0]]


# Written by the tools' own code from one pose, without their networks: ultralytics 8.4.190,
# mmpose 1.3.2, rtmlib 0.0.16, transformers 5.23.0, label-studio-sdk 2.1.2.
WRITTEN = [
    "ultralytics_to_json",
    "mmpose_inferencer",
    "mmpose_results",
    "rtmlib",
    "vitpose",
    "label_studio_coco",
]


@pytest.mark.parametrize("name", ["openpose", "mmpose", "labelstudio", *WRITTEN])
def test_one_pose_arrives_at_the_same_place_from_each_tool(name):
    given = read(name)
    assert place(given, "nose") == pytest.approx([524.26, 490.55], abs=1.0)
    assert place(given, "left_shoulder") == pytest.approx([537.58, 543.36], abs=1.0)


@pytest.mark.parametrize(
    ("name", "joint", "at"),
    [
        ("openpose_body25", "nose", (100, 200)),
        ("openpose_body25", "left_big_toe", (119, 219)),
        ("ultralytics_to_json", "left_eye", (526.76, 478.78)),
        ("coco_wholebody_dataset", "nose", (100, 90)),
    ],
)
def test_a_joint_of_each_skeleton_is_named_as_its_tool_means_it(name, joint, at):
    assert place(read(name), joint) == pytest.approx(at)


def test_the_feet_of_coco_wholebody_are_read_from_their_part():
    given = read("coco_wholebody_dataset")
    assert {"left_big_toe", "right_heel"} <= set(given.joint)


def test_scores_are_confidences_and_low_ones_are_left_out_with_a_note():
    given = read("couple_low_scores", (1920, 1278))
    assert len(given.joint) == 30
    assert given.confidence == pytest.approx(np.full(30, 0.9))
    assert "4" in given.notes[0]


def test_zero_zero_of_a_detector_is_no_place():
    given = read("results_zero_xy_low_score")
    assert (given.points > 0).all()


def test_a_file_for_a_smaller_copy_is_scaled_with_a_note():
    given = read("couple_dataset_1728", (1920, 1278))
    stated = json.loads((FILES / "couple_dataset_1728.json").read_text())
    x, y, _ = stated["annotations"][0]["keypoints"][:3]
    scale = np.array([1920 / 1728, 1278 / 1150])
    first = given.points[0]
    assert first == pytest.approx((np.array([x, y]) + 0.5) * scale - 0.5)
    assert "1728 x 1150" in given.notes[0]


def test_a_file_for_a_turned_picture_is_refused():
    with pytest.raises(InputError, match="neither cropped nor turned"):
        read("couple_dataset_1728", (1278, 1920))


def test_a_joint_outside_of_the_photo_is_left_out_with_a_note():
    given = read("detector_one_outside")
    assert "nose" not in given.joint
    assert len(given.joint) == 16
    assert "outside" in given.notes[0]


def test_of_two_images_that_of_the_photo_is_read():
    assert len(read("dataset_two_images", photo="slope.jpg").joint) > 0
    with pytest.raises(InputError, match="2 images"):
        read("dataset_two_images", photo="other.jpg")


def leaves(value, path=()):
    """The path of each number of a document."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, (*path, key))
    elif not isinstance(value, str):
        yield path


def with_leaf(document, path, text):
    """The text of a document in which a leaf is another text of JSON."""
    copy = json.loads(json.dumps(document))
    place = copy
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = "@"
    return json.dumps(copy).replace('"@"', text)


def known(file):
    """What is read of a file, or the error."""
    try:
        return read_keypoints(str(file), *SIZES_OF.get(file.parent.name, SLOPE), "slope.jpg")
    except InputError as error:
        return str(error)


SIZES_OF = {"couple_dataset_1728": (1920, 1278), "couple_low_scores": (1920, 1278)}


@pytest.mark.parametrize("wrong", ["9" * 400, '"12"', "true", "null", "[]", '"NaN"'])
@pytest.mark.parametrize("name", sorted(path.stem for path in FILES.glob("*.json")))
def test_a_value_of_another_kind_is_refused_or_named_or_changes_nothing(tmp_path, name, wrong):
    document = json.loads((FILES / f"{name}.json").read_text())
    folder = tmp_path / name
    folder.mkdir()
    file = folder / "a.json"
    file.write_text(json.dumps(document))
    right = known(file)
    every = list(leaves(document))
    for path in every[:: max(1, len(every) // 12)]:
        file.write_text(with_leaf(document, path, wrong))
        found = known(file)
        if isinstance(found, str) or isinstance(right, str) or found.notes != right.notes:
            continue
        assert found.joint == right.joint, path
        assert np.array_equal(found.points, right.points), path
        sure, before = (np.array(one.confidence, float) for one in (found, right))
        assert np.array_equal(sure, before, equal_nan=True), path


def of_coco(person, image_id, **others):
    keypoints = [value for x in range(17) for value in (100 + 9 * x + person, 200 + 9 * x, 2)]
    own = {"category_id": 1, "keypoints": keypoints, **others}
    return own if image_id is None else {**own, "image_id": image_id}


@pytest.mark.parametrize("ids", [(1, "1"), (None, None), (1, None), ("a", "a"), (7.0, 7)])
def test_people_of_one_image_are_read_however_its_id_is_written(tmp_path, ids):
    document = {"annotations": [of_coco(i, one) for i, one in enumerate(ids)]}
    given = read_keypoints(written(tmp_path, document), *SLOPE)
    assert set(given.person) == {0, 1}


@pytest.mark.parametrize(("other", "said"), [(3, "is of image 3"), (None, "needs an image_id")])
def test_an_annotation_of_no_image_of_the_file_is_refused(tmp_path, other, said):
    images = [{"id": 1, "file_name": "a.jpg"}, {"id": 2, "file_name": "slope.jpg"}]
    document = {"images": images, "annotations": [of_coco(0, 2), of_coco(1, other)]}
    with pytest.raises(InputError, match=f"annotation 1 {said}"):
        read_keypoints(written(tmp_path, document), *SLOPE, "slope.jpg")


def of_openpose(unit_of_hand=1.0, unit_of_second=1.0):
    body = [value for k in range(18) for value in (300 + 5 * k, 400 + 20 * k, 0.9)]
    hand = [value for k in range(21) for value in (350 + k, 600 + k, 0.9)]

    def in_shares(values, unit):
        scaled = np.reshape(values, (-1, 3)) * ([1, 1, 1] if unit == 1 else [1 / 720, 1 / 1280, 1])
        return scaled.ravel().tolist()

    first = {
        "pose_keypoints_2d": body,
        "hand_left_keypoints_2d": in_shares(hand, unit_of_hand),
    }
    return {"people": [first, {"pose_keypoints_2d": in_shares(body, unit_of_second)}]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"unit_of_hand": 0}, "left hand of person 0"),
        ({"unit_of_second": 0}, "body of person 1"),
    ],
)
def test_a_part_or_person_in_shares_beside_others_in_px_is_refused(tmp_path, changes, words):
    with pytest.raises(InputError, match=words):
        read_keypoints(written(tmp_path, of_openpose(**changes)), *SLOPE)
    assert len(read_keypoints(written(tmp_path, of_openpose()), *SLOPE).joint) == 17 * 2 + 20


@pytest.mark.parametrize("within", [list, lambda pictures: {"info": "", "poses": pictures}])
def test_openposes_object_is_read_from_a_list_of_one_picture(tmp_path, within):
    document = of_openpose()
    given = read_keypoints(written(tmp_path, within([document])), *SLOPE)
    assert len(given.joint) == 17 * 2 + 20
    with pytest.raises(InputError, match="2 images"):
        read_keypoints(written(tmp_path, within([document] * 2)), *SLOPE)


def written(folder, document):
    file = folder / "given.json"
    file.write_text(json.dumps(document))
    return str(file)


POINTS = [[100.0 + row, 200.0 + 2 * row] for row in range(17)]
SCORES = [0.9] * 16 + [0.1]


@pytest.mark.parametrize(
    "document",
    [
        [
            {
                "keypoints": POINTS,
                "scores": SCORES,
                "labels": list(range(17)),
                "bbox": [90, 190, 40, 60],
            }
        ],
        {"keypoints": [POINTS], "scores": [SCORES]},
        {"predictions": [[{"keypoints": POINTS, "keypoint_scores": SCORES}]]},
        [{"keypoints": POINTS, "keypoint_scores": SCORES}],
    ],
    ids=["transformers", "rtmlib", "mmpose predictions", "mmpose file of an image"],
)
def test_points_and_scores_apart_are_read(tmp_path, document):
    given = read_keypoints(written(tmp_path, document), *SLOPE)
    assert given.points == pytest.approx(np.array(POINTS[:16]))
    assert given.joint[-1] == "left_ankle"


def test_a_file_most_of_whose_points_lie_outside_is_refused():
    with pytest.raises(InputError, match="30 of 30 keypoints lie outside"):
        read("couple_low_scores", (400, 300))


def annotation(image, third):
    flat = [number for x, y in POINTS for number in (x, y, third)]
    return {"image_id": image, "category_id": 1, "keypoints": flat}


IMAGES = [{"id": 1, "file_name": "a.jpg"}, {"id": 2, "file_name": "b.jpg"}]


def test_joints_of_another_image_are_not_those_of_a_photo_that_has_none(tmp_path):
    file = written(tmp_path, {"images": IMAGES, "annotations": [annotation(2, 2)]})
    with pytest.raises(InputError, match="no keypoints"):
        read_keypoints(file, *SLOPE, "a.jpg")
    with pytest.raises(InputError, match="2 images"):
        read_keypoints(file, *SLOPE)


POSE = {"keypoints": [[50 + 9 * n, 90 + 7 * n] for n in range(17)], "keypoint_scores": [0.9] * 17}
COCO = {"image_id": 1, "keypoints": [50, 90, 2] * 17}
MARK = {"original_width": 720, "original_height": 1280, "type": "keypointlabels"}
MARK |= {"value": {"x": 9, "y": 9, "keypointlabels": ["nose"]}}


@pytest.mark.parametrize(
    ("document", "key"),
    [
        ({"images": [{"id": 1, "crop": [9, 9]}], "annotations": [COCO]}, "crop"),
        ({"annotations": [COCO | {"ignore": 1}]}, "ignore"),
        ({"people": [{"pose_keypoints_2d": [50] * 51, "face_keypoints_2d": [9]}]}, "face"),
        ({"instance_info": [POSE | {"img_size": [9, 9]}]}, "img_size"),
        ({"instance_info": [POSE], "image": "b.jpg"}, "image"),
        ([{"annotations": [{"result": [MARK | {"item_index": 3}]}]}], "item_index"),
    ],
)
def test_a_key_that_is_not_used_is_named(tmp_path, document, key):
    (tmp_path / "a.json").write_text(json.dumps(document))
    assert any(key in note for note in read_keypoints(str(tmp_path / "a.json"), *SLOPE).notes)


@pytest.mark.parametrize(
    ("document", "said"),
    [
        ({"meta_info": {"keypoint_id2name": {"0": "root"}}, "instance_info": [POSE]}, "root"),
        ([{"annotations": [{"was_cancelled": True, "result": [MARK]}]}], "no keypoints"),
        ([{"annotations": [{"result": [MARK, MARK | {"original_width": 9}]}]}], "several"),
    ],
)
def test_what_has_another_meaning_is_refused(tmp_path, document, said):
    (tmp_path / "a.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=said):
        read_keypoints(str(tmp_path / "a.json"), *SLOPE)


@pytest.mark.parametrize("label", [-1, 17])
def test_a_label_of_no_joint_is_refused(tmp_path, label):
    document = [{"keypoints": [[100.0, 200.0]], "scores": [0.9], "labels": [label]}]
    with pytest.raises(InputError, match=f"label {label}"):
        read_keypoints(written(tmp_path, document), *SLOPE)


def test_scores_above_1_count_as_1_with_a_note(tmp_path):
    given = read_keypoints(
        written(tmp_path, {"keypoints": [POINTS], "scores": [[5.1] * 17]}), *SLOPE
    )
    assert given.confidence is not None
    assert given.confidence.max() == 1
    assert "5.1" in given.notes[-1]


def test_without_a_reader_json_is_refused_with_what_to_install(monkeypatch):
    monkeypatch.setenv("PHYSIC_PLUGINS", "metricbody-testing")
    with pytest.raises(PackageMissingError, match="metricbody-embedded"):
        read("openpose")


@pytest.mark.parametrize(
    ("name", "keys", "value"),
    [
        ("ultralytics_to_json", (0, "keypoints", "visible"), ""),
        ("openpose", ("people", 0, "pose_keypoints_2d"), ""),
        ("coco_wholebody_dataset", ("images",), ""),
        ("labelstudio", (0, "annotations", 0, "result", 0, "type"), None),
        ("labelstudio", (0, "annotations", 0, "result", 0, "value", "keypointlabels"), "n"),
    ],
)
def test_what_is_false_or_of_another_kind_is_no_empty_list(tmp_path, name, keys, value):
    document = json.loads((FILES / f"{name}.json").read_text())
    *path, last = keys
    entry = document
    for key in path:
        entry = entry[key]
    entry[last] = value
    file = tmp_path / "keypoints.json"
    file.write_text(json.dumps(document))
    with pytest.raises(InputError):
        read_keypoints(str(file), *SLOPE)


def test_marks_of_another_type_are_counted(tmp_path):
    document = json.loads((FILES / "labelstudio.json").read_text())
    document[0]["annotations"][0]["result"][0]["type"] = "rectanglelabels"
    file = tmp_path / "keypoints.json"
    file.write_text(json.dumps(document))
    given = read_keypoints(str(file), *SLOPE)
    assert "nose" not in given.joint
    assert any(note.startswith("left out 1 marks") for note in given.notes)
