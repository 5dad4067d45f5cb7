"""Keypoints of one photo as other programs write them in JSON: which form it is, and the rows of
each form.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from physic_core.files import boolean, count, entries, identity, matrix, number, quoted
from physic_core.types import SKELETONS, KeypointTable

Row = tuple[int, str, float, float, float]
"""Number of the annotation, joint, x and y in px, and visibility or score."""


def _names(skeleton: str) -> tuple[str, ...]:
    return tuple(name.removesuffix("_surface") for name in SKELETONS[skeleton].names)


_WHOLE_BODY = _names("coco_wholebody133")
_BY_COUNT = {17: _names("coco17"), 23: _names("coco23"), 26: _names("halpe26"), 133: _WHOLE_BODY}
_PARTS = {
    "foot_kpts": (17, 23),
    "face_kpts": (23, 91),
    "lefthand_kpts": (91, 112),
    "righthand_kpts": (112, 133),
}

# What COCO and the tools write beside keypoints, and what changes none of them.
_OF_DATASET = "info licenses images annotations categories"
_OF_IMAGE = "id file_name width height license coco_url flickr_url date_captured"
_OF_PERSON = (
    "keypoints scores keypoint_scores labels bbox bboxes bbox_score score name box confidence "
    "track_id"
)
_OF_ANNOTATION = (
    f"{_OF_PERSON} id image_id category_id area segmentation num_keypoints face_box lefthand_box "
    "righthand_box foot_valid face_valid lefthand_valid righthand_valid center scale"
)
_OF_MARK = "id type value origin to_name from_name image_rotation original_width original_height"
_OF_OPENPOSE = (
    "person_id pose_keypoints_2d hand_left_keypoints_2d hand_right_keypoints_2d pose_keypoints_3d "
    "face_keypoints_3d hand_left_keypoints_3d hand_right_keypoints_3d"
)

# OpenPose's joints in its order, "" where COCO's skeletons have none.
_ARMS = tuple(
    f"{side}_{joint}" for side in ("right", "left") for joint in ("shoulder", "elbow", "wrist")
)
_LEGS = tuple(f"{side}_{joint}" for side in ("right", "left") for joint in ("hip", "knee", "ankle"))
_HEAD = ("right_eye", "left_eye", "right_ear", "left_ear")
_FEET = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("big_toe", "small_toe", "heel")
)
_OPENPOSE = {
    18: ("nose", "", *_ARMS, *_LEGS, *_HEAD),
    25: ("nose", "", *_ARMS, "", *_LEGS, *_HEAD, *_FEET),
}


def table_of(document: Any, photo: str) -> KeypointTable | None:
    """Return the keypoints of a JSON document, None if its format is unknown.

    Args:
        document: parsed.
        photo: name of the photo's file, or "": which image of several is meant.

    Raises:
        ValueError: the form is known and refused, or a list has another length than its skeleton.
    """
    for is_form, read in _FORMS:
        if is_form(document):
            return read(document, photo)
    for is_form, converts in _REFUSED:
        if is_form(document):
            raise ValueError(converts)
    return None


def _first(document: Any) -> Mapping[str, Any]:
    """Return the first entry of a list of objects, or an empty one."""
    is_list = isinstance(document, list) and bool(document) and isinstance(document[0], Mapping)
    return document[0] if is_list else {}


def _is_coco(document: Any) -> bool:
    if isinstance(document, Mapping):
        return isinstance(document.get("annotations"), list)
    return (
        document == []
        or ("image_id" in _first(document))
        or _is_flat(_first(document).get("keypoints"))
    )


def _is_flat(values: Any) -> bool:
    return isinstance(values, list) and bool(values) and isinstance(values[0], int | float)


def _read_coco(document: Any, photo: str) -> KeypointTable:
    """Read a COCO dataset, its annotations, or results; COCO-WholeBody has parts beside the
    keypoints.
    """
    dataset = document if isinstance(document, Mapping) else {}
    annotations = dataset.get("annotations") if dataset else document
    if not isinstance(annotations, list) or not all(
        isinstance(annotation, Mapping) for annotation in annotations
    ):
        raise ValueError("it has no list of annotations")
    images = by_id(dataset, "images")
    image, of_image = annotations_of_photo(annotations, images, photo)
    names = {
        key: tuple(identity(name, "the name of a joint") for name in annotation["keypoints"])
        for key, annotation in by_id(dataset, "categories").items()
        if annotation.get("keypoints")
    }
    everywhere: list[Row] = []
    rows: list[Row] = []
    for person, annotation in enumerate(annotations):
        names_of_category = names.get(id_of(annotation, "category_id"))
        triples = list(_triples(person, annotation.get("keypoints"), names_of_category))
        for part, (start, stop) in _PARTS.items():
            triples += _triples(person, annotation.get(part), _WHOLE_BODY[start:stop])
        everywhere += triples
        rows += triples if any(annotation is other for other in of_image) else []
    # A score of another image of the file says what the numbers of this one are.
    scored = any(row[4] not in (0, 1, 2) for row in everywhere)
    about = images.get(image, {})
    size = stated_size(about, "width", "height")
    notes = (
        *_note_on_other_name(about, "file_name", photo),
        *_note_on_unread((dataset,), _OF_DATASET),
        *_note_on_unread((about,), _OF_IMAGE),
        *_note_on_unread(of_image, f"{_OF_ANNOTATION} {' '.join(_PARTS)}"),
    )
    return KeypointTable(tuple(_first_visible(rows)), scored, size, notes)


def by_id(dataset: Mapping[str, Any], key: str) -> dict[str, Mapping[str, Any]]:
    """Return the images or categories of a dataset of COCO by their id."""
    return {id_of(one, "id"): one for one in entries(dataset.get(key), key)}


def id_of(entry: Mapping[str, Any], key: str) -> str:
    """Return the id of an object of COCO, "" without one; programs write numbers and texts."""
    return "" if entry.get(key) is None else identity(entry[key], key)


def annotations_of_photo(
    annotations: Sequence[Mapping[str, Any]], images: Mapping[str, Any], photo: str
) -> tuple[str, list[Mapping[str, Any]]]:
    """Return the id of the photo's image, and the annotations of it: of the only image, or the one
    of its name, listed or annotated.

    Raises:
        ValueError: it is not known which image is meant, or of which image an annotation is.
    """
    of = [id_of(annotation, "image_id") for annotation in annotations]
    ids = {*of, *images} - {""}
    if len(ids) < 2:  # those without an id are of the only image
        return next(iter(ids), ""), list(annotations)
    if "" in of:
        raise ValueError(
            f"annotation {of.index('')} needs an image_id: the file has {len(ids)} images"
        )
    if images and (unlisted := [key for key in of if key not in images]):
        raise ValueError(
            f"annotation {of.index(unlisted[0])} is of image {unlisted[0]}, which the images of "
            "the file do not have"
        )
    stem = PurePath(photo).stem
    named = [
        key
        for key in ids
        if stem and PurePath(str(images.get(key, {}).get("file_name", ""))).stem == stem
    ]
    if len(named) != 1:
        raise ValueError(
            f"it has {len(ids)} images, and none is named {stem or 'as the photo'}: keep its"
        )
    return named[0], [
        annotation for annotation, key in zip(annotations, of, strict=True) if key == named[0]
    ]


def _note_on_other_name(entry: Mapping[str, Any], key: str, photo: str) -> tuple[str, ...]:
    """Return a note if an entry names another picture than the photo."""
    named = PurePath(str(entry.get(key) or "").replace("\\", "/")).name
    if not photo or not named or PurePath(named).stem == PurePath(photo).stem:
        return ()
    return (f"the given keypoints are of the picture {quoted(named)}, and the photo is {photo}",)


def _note_on_unread(entries: Iterable[Any], names: str) -> tuple[str, ...]:
    """Return a note on keys of a file's objects that are neither read nor known to change nothing;
    zeros and empty values change nothing either.
    """
    objects = (one for one in entries if isinstance(one, Mapping))
    keys = {key for one in objects for key, value in one.items() if value}
    others = sorted(map(str, keys.difference(names.split())))
    return (f"in the file of keypoints, PhySIC ignores {', '.join(others[:8])}",) if others else ()


def _triples(person: int, numbers: Any, names: Sequence[str] | None) -> Iterable[Row]:
    """Yield the rows of a flat list x, y, v, x, y, v, ..."""
    numbers = matrix([] if numbers is None else numbers, f"annotation {person}").ravel().tolist()
    if not numbers:
        return
    joints = names or _BY_COUNT.get(len(numbers) // 3, ())
    if len(numbers) != 3 * len(joints):
        wanted = (
            len(joints) or f"{', '.join(map(str, list(_BY_COUNT)[:-1]))} or {list(_BY_COUNT)[-1]}"
        )
        raise ValueError(
            f"annotation {person} has {len(numbers)} numbers for {wanted} keypoints of x, y, v"
        )
    for row, joint in enumerate(joints):
        if joint:
            x, y, third = numbers[3 * row : 3 * row + 3]
            yield person, str(joint), x, y, third


def _first_visible(rows: Iterable[Row]) -> Iterable[Row]:
    """Yield the first visible row of each joint of a person: the wrist is in the hand's part,
    too.
    """
    kept: dict[tuple[int, str], Row] = {}
    for row in rows:
        at = row[0], row[1]
        if at not in kept or kept[at][4] <= 0:
            kept[at] = row
    return kept.values()


def stated_size(entry: Mapping[str, Any], width: str, height: str) -> tuple[int, int] | None:
    """Return the size that an object states; None if it states none, or 0.

    Raises:
        ValueError: a side is no whole number, or only one is stated.
    """
    sides = [
        (0 if entry.get(key) is None else count(entry[key], key), key) for key in (width, height)
    ]
    if not any(side for side, _ in sides):
        return None
    if wrong := [f"{key} is {side}" for side, key in sides if side < 1]:
        raise ValueError(f"the {wrong[0]} of a picture")
    return sides[0][0], sides[1][0]


def _pairs(
    person: int, points: Any, scores: Any, names: Sequence[str] | None = None
) -> Iterable[Row]:
    """Yield the rows of a list of points and a list of scores."""
    joints = names or _BY_COUNT.get(len(points), ())
    if len(joints) != len(points) or len(scores) != len(points):
        raise ValueError(
            f"person {person} has {len(points)} keypoints and {len(scores)} scores: 17, 23, 26 or "
            f"133 fit"
        )
    places = matrix(points, f"the keypoints of person {person}")
    values = matrix(scores, f"the scores of person {person}").ravel()
    for joint, at, score in zip(joints, places.tolist(), values.tolist(), strict=True):
        yield person, joint, at[0], at[1], score


def _read_openpose(document: Any, photo: str) -> KeypointTable:
    """Read OpenPose's JSON; other tools write COCO's 17, 23, 26 or 133 joints in it."""
    rows: list[Row] = []
    for person, one in enumerate(document["people"]):
        body = entries(one.get("pose_keypoints_2d"), f"pose_keypoints_2d of person {person}")
        rows += _triples(person, body, _OPENPOSE.get(len(body) // 3))
        for side in ("left", "right"):
            hand = _names(f"openpose_hand21_{side}")
            rows += _triples(person, one.get(f"hand_{side}_keypoints_2d"), hand)
    size = stated_size(document, "canvas_width", "canvas_height")
    notes = _note_on_unread(document["people"], _OF_OPENPOSE)
    return KeypointTable(tuple(_first_visible(rows)), True, size, notes)


def _openpose_pictures(document: Any) -> Any:
    """Return OpenPose's objects, one a picture, that nodes of ComfyUI list, and a web UI answers
    with; [] for other documents.
    """
    pictures = document.get("poses") if isinstance(document, Mapping) else document
    return pictures if "people" in _first(pictures) else []


def _read_openpose_picture(document: Any, photo: str) -> KeypointTable:
    pictures = _openpose_pictures(document)
    if len(pictures) > 1:
        raise ValueError(f"it has people of {len(pictures)} images: keep only this photo's")
    return _read_openpose(pictures[0], photo)


def _read_ultralytics(document: Any, photo: str) -> KeypointTable:
    rows: list[Row] = []
    for person, one in enumerate(document):
        marks = {"x": [], "y": []} if one.get("keypoints") is None else one["keypoints"]
        scores = entries(marks.get("visible", [1.0] * len(marks["x"])), "visible")
        if marks["x"]:
            rows += _pairs(person, list(zip(marks["x"], marks["y"], strict=True)), scores)
    return KeypointTable(tuple(rows), True, notes=_note_on_unread(document, _OF_PERSON))


def _read_scored(document: Any, photo: str) -> KeypointTable:
    """Read points and scores apart: mmpose's and rtmlib's ``keypoint_scores``, transformers'
    ``scores``.
    """
    about = document if isinstance(document, Mapping) else {}
    _check_names(about.get("meta_info") or {})
    people = _scored_people(document)
    if isinstance(people, Mapping):  # rtmlib's two arrays, as lists
        scores = people.get("keypoint_scores", people.get("scores"))
        keys = zip(people["keypoints"], scores or (), strict=True)
        people = [{"keypoints": points, "keypoint_scores": values} for points, values in keys]
    while people and isinstance(people[0], list):  # one list an image
        if len(people) > 1:
            raise ValueError(f"it has people of {len(people)} images: keep only this photo's")
        people = people[0]
    rows: list[Row] = []
    for person, entry in enumerate(people):
        scores = entry.get("keypoint_scores", entry.get("scores"))
        labels = entry.get("labels")
        names = None if labels is None else [_joint_of_label(label) for label in labels]
        rows += _pairs(person, entry["keypoints"], scores or (), names)
    notes = (
        *_note_on_unread((about,), f"{_OF_PERSON} meta_info instance_info predictions"),
        *_note_on_unread(people, _OF_PERSON),
    )
    return KeypointTable(tuple(rows), True, notes=notes)


def _check_names(meta: Mapping[str, Any]) -> None:
    """Refuse a skeleton of mmpose whose first joints are not COCO's."""
    stated = list((meta.get("keypoint_id2name") or {}).values())
    if stated and tuple(stated[: len(_BY_COUNT[17])]) != _BY_COUNT[17]:
        raise ValueError(
            f"its skeleton begins with {', '.join(map(str, stated[:3]))}, and those that are read "
            f"with {', '.join(_BY_COUNT[17][:3])}: give COCO's, or CSV with the names"
        )


def _joint_of_label(label: Any) -> str:
    """Return the joint of a label of transformers, which counts COCO's 17."""
    joints = _BY_COUNT[17]
    number = count(label, "a label")
    if not 0 <= number < len(joints):
        raise ValueError(
            f"it has the label {number}, and those of COCO's joints are 0 to {len(joints) - 1}"
        )
    return joints[number]


def _scored_people(document: Any) -> Any:
    """Return what has the people of a document with points and scores apart."""
    about = document if isinstance(document, Mapping) else {}
    return about.get("instance_info", about.get("predictions", document))


def _has_scores(document: Any) -> bool:
    people = _innermost_list(_scored_people(document))
    entry = people if isinstance(people, Mapping) else _first(people)
    return "keypoints" in entry and ("keypoint_scores" in entry or "scores" in entry)


def _read_label_studio(document: Any, photo: str) -> KeypointTable:
    """Read Label Studio's export of one task: each mark is a percentage of the image; all are of
    one person.
    """
    tasks = document if isinstance(document, list) else [document]
    if len(tasks) > 1:
        raise ValueError(f"it has {len(tasks)} tasks of Label Studio: keep only this photo's")
    marks = [
        mark
        for annotation in tasks[0]["annotations"]
        if not boolean(annotation.get("was_cancelled"), "was_cancelled")
        for mark in annotation.get("result", ())
    ]
    others = sum(identity(mark["type"], "a type") != "keypointlabels" for mark in marks)
    rows: list[Row] = []
    size = None
    notes = (
        *(f"left out {others} marks of Label Studio that are no keypoints",) * bool(others),
        *_note_on_other_name(tasks[0].get("data") or {}, "image", photo),
        *_note_on_unread(marks, _OF_MARK),
        *_note_on_unread((mark["value"] for mark in marks), "x y width keypointlabels"),
    )
    for mark in marks:
        if mark["type"] != "keypointlabels":
            continue
        stated = stated_size(mark, "original_width", "original_height")
        if size not in (None, stated) or len(mark["value"]["keypointlabels"]) > 1:
            raise ValueError("marks of Label Studio have several pictures, or several labels each")
        size = stated
        if number(mark.get("image_rotation") or 0, "image_rotation"):
            raise ValueError("a mark is of the turned picture: turn it back in Label Studio")
        if size is None:
            raise ValueError("a mark of Label Studio lacks original_width and original_height")
        value = mark["value"]
        x, y = (
            number(value[axis], axis) / 100 * side - 0.5
            for axis, side in zip("xy", size, strict=True)
        )
        label = identity(entries(value["keypointlabels"], "keypointlabels")[0], "a label")
        rows.append((0, label, x, y, 2.0))
    return KeypointTable(tuple(rows), False, size, notes)


def _is_label_studio(document: Any) -> bool:
    task = document if isinstance(document, Mapping) else _first(document)
    annotations = task.get("annotations")
    return isinstance(annotations, list) and "result" in _first(annotations)


def _innermost_list(document: Any) -> Any:
    """Return the first list of objects in lists of lists, or the document itself."""
    while isinstance(document, list) and document and isinstance(document[0], list):
        document = document[0]
    return document


def _is_mediapipe(document: Any) -> bool:
    """Return whether a document has landmarks of MediaPipe, in its objects or alone."""
    for key in ("pose_landmarks", "landmarks", "landmark"):
        document = _innermost_list(
            document.get(key, document) if isinstance(document, Mapping) else document
        )
    return {"x", "y", "z"} <= _first(document).keys()


_LABELME = """it is a file of labelme; this Python prints it as CSV:
    import json
    print("person,joint,x,y")
    for mark in json.load(open("FILE.json"))["shapes"]:
        print(mark["group_id"] or 0, mark["label"], *mark["points"][0], sep=",")"""
_MEDIAPIPE = """it has landmarks of MediaPipe, which are shares of the picture; this Python prints them:
    from physic_core.types.skeletons import SKELETONS
    print("person,joint,x,y")
    for name, mark in zip(SKELETONS["blazepose33"].names, LANDMARKS):
        if mark["visibility"] > 0.5:
            print(0, name, mark["x"] * WIDTH - 0.5, mark["y"] * HEIGHT - 0.5, sep=",")"""  # noqa: E501
_REFUSED: tuple[tuple[Callable[[Any], bool], str], ...] = (
    (lambda d: isinstance(d, Mapping) and "shapes" in d, _LABELME),
    (_is_mediapipe, _MEDIAPIPE),
)
_Reader = Callable[[Any, str], KeypointTable]
_FORMS: tuple[tuple[Callable[[Any], bool], _Reader], ...] = (
    (_is_label_studio, _read_label_studio),
    (lambda d: isinstance(d, Mapping) and "people" in d, _read_openpose),
    (lambda d: bool(_openpose_pictures(d)), _read_openpose_picture),
    (lambda d: isinstance(_first(d).get("keypoints"), Mapping), _read_ultralytics),
    (_has_scores, _read_scored),
    (_is_coco, _read_coco),
)
