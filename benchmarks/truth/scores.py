"""Answers against truth: one record for each person, floor and photo."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.truth.joints import BODY_ROWS, is_upright, limb_joints, root
from benchmarks.truth.triangulation import match_views, visible_joints
from physic_core.body.posture import angle_deg

from .contact import part_record
from .measures import (
    box_of,
    match_people,
    points_error,
    pose_errors,
    spread_m,
)
from .sets import Sample, camera_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.cameras import Camera

    Array = NDArray[np.float64]
    Answer = Mapping[str, Any]
    Record = dict[str, Any]

SEEN = 0.3
"""Confidence from which a keypoint of the tool counts."""

MIN_VISIBLE = 8
"""Joints of twelve in the picture from which somebody counts as visible in a view."""

LIMBS = {
    "l_ankle": "left_foot",
    "r_ankle": "right_foot",
    "l_fingers": "left_hand",
    "r_fingers": "right_hand",
}
"""Where forces were measured: the set of vertices that touches there."""


def joints_of(person: Mapping[str, Any]) -> Array:
    """(12, 3) m; NaN where the person has no body."""
    return np.array(person["joints"], np.float64)[BODY_ROWS]


def keypoints_of(person: Mapping[str, Any]) -> Array:
    """(12, 2) px of the tool's keypoints, NaN where it sees none."""
    points = np.array(person["keypoints"], np.float64)
    return np.where(points[:, 2:] >= SEEN, points[:, :2], np.nan)


def people_of(answer: Answer) -> list[Mapping[str, Any]]:
    """Those who have a body: a person without one is not found."""
    return [person for person in answer["people"] if np.isfinite(joints_of(person)).all()]


def compared(
    samples: Sequence[Sample],
    answers: Sequence[dict[str, Any]],
    earlier: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The records of all people, floors, body parts and photos, and the joints that were
    triangulated.
    """
    people: list[Any] = []
    floors: list[Any] = []
    parts: list[Any] = []
    triangulated: dict[str, Any] = {}
    moments: dict[str, list[tuple[Sample, dict[str, Any]]]] = {}
    for sample, answer in zip(samples, answers, strict=True):
        if sample.set == "mpi_inf_3dhp":
            records, ground = score_single(sample, answer)
            people += records
            floors += ground
        elif sample.set == "people2d":
            people += score_annotated(sample, answer)
        elif sample.set == "parkour":
            person, touching = score_parkour(sample, answer)
            people.append(person)
            parts += touching
        elif "camera" in sample.truth:
            moments.setdefault(f"{sample.set}/{sample.group}", []).append((sample, answer))
    for name, views in moments.items():
        truth = (
            [np.array(joints, np.float64) for joints in earlier[name]]
            if earlier and name in earlier
            else None
        )
        records, ground, joints = score_moment([s for s, _ in views], [a for _, a in views], truth)
        people += records
        floors += ground
        triangulated[name] = [np.round(j, 5).tolist() for j in joints]
    photos = [photo_record(sample, answer) for sample, answer in zip(samples, answers, strict=True)]
    return {
        "people": people,
        "floors": floors,
        "parts": parts,
        "photos": photos,
        "triangulated": triangulated,
    }


def photo_record(sample: Sample, answer: Answer) -> Record:
    """Errors of depth."""
    depths = {key: answer.get(key, math.nan) for key in ("absrel", "absrel_scaled")}
    return {**_of(sample), "error": answer["error"], **depths}


def score_single(sample: Sample, answer: Answer) -> tuple[list[Record], list[Record]]:
    """People and floors of a photo of mpi_inf_3dhp."""
    truth = limb_joints(sample.truth["joints"], 3)
    up = None if sample.truth["up"] is None else np.array(sample.truth["up"], np.float64)
    pixels = truth @ np.array(sample.truth["K"]).T
    pixels = pixels[:, :2] / pixels[:, 2:]
    people = [_person(sample, "0", truth, up, matched_people(answer, [pixels]).get(0))]
    floors = []
    if up is not None:
        height = float(-up @ np.array(sample.truth["floor_point"]))
        floors.append(floor_record(sample, answer, up, height))
    return people, floors


def score_moment(
    samples: Sequence[Sample], answers: Sequence[Answer], truth: Sequence[Array] | None = None
) -> tuple[list[Record], list[Record], list[Array]]:
    """People and floors of all views of one moment, and the joints (12, 3) m of the world that they
    are held against.

    Args:
        samples: a view each.
        answers: the tool's.
        truth: joints that an earlier run triangulated; from the answers' own keypoints without it.
    """
    cameras = [camera_of(sample) for sample in samples]
    if truth is None:
        true_people = match_views(
            cameras, [[keypoints_of(p) for p in people_of(answer)] for answer in answers]
        )
        truth = [person.joints for person in true_people]
    views = list(zip(samples, answers, cameras, strict=True))
    people = [one for view in views for one in _seen_people(*view, truth)]
    floors = [
        floor_record(
            sample,
            answer,
            camera.R @ sample.truth["up"],
            float(camera.to_world(np.zeros(3)) @ sample.truth["up"]),
        )
        for sample, answer, camera in views
    ]
    for name in {record["person"] for record in people}:
        of_person = [record for record in people if record["person"] == name]
        places = [record.pop("pelvis") for record in of_person if "pelvis" in record]
        for record in of_person:
            record["spread_m"] = spread_m(np.array(places))
    return people, floors, list(truth)


def _seen_people(
    sample: Sample, answer: Answer, camera: Camera, truth: Sequence[Array]
) -> Iterator[Record]:
    """Yield the people whom a view shows, who are found with "pelvis", (3,) m of the world."""
    shown = [visible_joints(camera, joints) for joints in truth]
    joint_counts = [int(np.isfinite(joints).all(-1).sum()) for joints in truth]
    visible = [i for i in range(len(truth)) if shown[i].sum() >= min(MIN_VISIBLE, joint_counts[i])]
    pixels = [np.where(shown[i][:, None], camera.project(truth[i]), np.nan) for i in visible]
    matched = matched_people(answer, pixels)
    up = camera.R @ sample.truth["up"]
    for row, i in enumerate(visible):
        person = matched.get(row)
        record = _person(sample, str(i), camera.to_camera(truth[i]), up, person)
        if person is not None:
            record["pelvis"] = camera.to_world(root(joints_of(person)))
        yield record


def score_annotated(sample: Sample, answer: Answer) -> list[Record]:
    """Annotated people of a photo of people2d: found or not, and the error of their final joints in
    the picture.
    """
    everybody = sample.truth["people"]
    boxes = [[x, y, x + w, y + h] for x, y, w, h in (person["box_xywh"] for person in everybody)]
    marks = [limb_joints(person["keypoints"], 3) for person in everybody]
    estimated = people_of(answer)
    matched = match_people(
        [p["box"] for p in estimated],
        [keypoints_of(p) for p in estimated],
        boxes,
        [mark[:, :2] for mark in marks],
    )
    records = []
    for i, (box, mark) in enumerate(zip(boxes, marks, strict=True)):
        record: Record = {
            **_of(sample),
            "person": str(i),
            "found": i in matched,
            "visible": [],
            "hidden": [],
        }
        if i in matched:
            pixels = projected(joints_of(estimated[matched[i]]), answer["camera"])
            record["visible"] = points_error(pixels, mark[:, :2], mark[:, 2] == 2, box)
            record["hidden"] = points_error(pixels, mark[:, :2], mark[:, 2] == 1, box)
            record["usable"] = estimated[matched[i]]["usable"]
        records.append(record)
    return records


def score_parkour(sample: Sample, answer: Answer) -> tuple[Record, list[Record]]:
    """The person and the four limbs of a picture of parkour.

    The largest box is theirs. Without a person found, nothing touches.
    """
    truth = limb_joints(sample.truth["joints"], 3)
    estimated = people_of(answer)
    person = max(
        estimated,
        key=lambda p: (p["box"][2] - p["box"][0]) * (p["box"][3] - p["box"][1]),
        default=None,
    )
    record: Record = {**_of(sample), "person": "0", "found": person is not None, "posture": ""}
    if person is not None:
        errors = pose_errors(joints_of(person), truth)
        # The camera is unknown: nothing else has a truth.
        record |= {"pa_mpjpe_mm": errors["pa_mpjpe_mm"], "usable": person["usable"]}
    parts = person["parts"] if person else dict.fromkeys(LIMBS.values(), 0.0)
    limbs = [
        part_record(sample, "0", part, parts[part], sample.truth["touches"][limb])
        for limb, part in LIMBS.items()
        if not sample.truth["uncaptured"][limb] and part in parts
    ]
    return record, limbs


def projected(joints: Array, camera: Sequence[float]) -> Array:
    """(J, 2) px of joints before the camera fx, fy, cx, cy."""
    fx, fy, cx, cy = camera
    return np.stack(
        [fx * joints[:, 0] / joints[:, 2] + cx, fy * joints[:, 1] / joints[:, 2] + cy], -1
    )


def matched_people(answer: Answer, pixels: Sequence[Array]) -> dict[int, Mapping[str, Any]]:
    """Of each true person, by the (12, 2) px of the joints, who is found of those with a body."""
    estimated = people_of(answer)
    boxes = [box_of(points).tolist() for points in pixels]
    rows = match_people(
        [p["box"] for p in estimated], [keypoints_of(p) for p in estimated], boxes, pixels
    )
    return {i: estimated[j] for i, j in rows.items()}


def _of(sample: Sample) -> Record:
    return {"set": sample.set, "photo": sample.name, "group": sample.group}


def _person(
    sample: Sample, name: str, truth: Array, up: Array | None, person: Mapping[str, Any] | None
) -> Record:
    posture = {True: "upright", False: "bent", None: "unknown"}[is_upright(truth, up)]
    record: Record = {
        **_of(sample),
        "person": name,
        "found": person is not None,
        "posture": posture,
    }
    if person is not None:
        record |= pose_errors(joints_of(person), truth) | {"usable": person["usable"]}
        distance = person.get("distance_sigma")
        stature = person.get("stature_sigma")
        record["distance_sigma"] = distance or math.nan
        record["distance_in_sigmas"] = _in_sigmas(record["pelvis_depth_ratio"], distance)
        record["stature_in_sigmas"] = _in_sigmas(record["bones_ratio"], stature)
        record["joints_in_sigmas"] = _joints_in_sigmas(record["joint_errors_m"], person)
        record |= {key: person[key] for key in ("evidence",) if key in person}
    return record


def _in_sigmas(ratio: float, log_sigma: float | None) -> float:
    """Error of the logarithm over its stated standard deviation; NaN where one is unknown."""
    return math.log(ratio) / log_sigma if log_sigma and ratio > 0 else math.nan


def _joints_in_sigmas(errors: Sequence[float], person: Mapping[str, Any]) -> float:
    """Root mean square of the joints' errors over their stated ones; NaN where none is stated."""
    if (stated := person.get("joint_sigma")) is None:
        return math.nan
    ratios = np.divide(errors, np.array(stated, np.float64)[BODY_ROWS])
    return float(np.sqrt(np.nanmean(ratios**2)))


def floor_record(sample: Sample, answer: Answer, up: Array, height: float) -> Record:
    """The errors of floor and up against the direction up and the camera's true height; the error
    of up over its stated one is that in each of two directions.
    """
    keys = ("floor_angle_deg", "camera_height_ratio", "up_angle_deg", "up_in_sigmas")
    record = {**_of(sample), **dict.fromkeys(keys, math.nan), "missing": answer["floor"] is None}
    if answer["floor"] is not None:
        *normal, offset = answer["floor"]
        record["floor_angle_deg"] = float(angle_deg(np.array(normal, np.float64), up))
        record["camera_height_ratio"] = float(offset / height)
    if answer.get("up") is not None and answer["up_sigma"]:
        angle = float(angle_deg(np.array(answer["up"], np.float64), up))
        record |= {"up_angle_deg": angle, "up_in_sigmas": angle / answer["up_sigma"] / 2**0.5}
    record["camera_height_off"] = abs(record["camera_height_ratio"] - 1)
    record["scale_in_sigmas"] = _in_sigmas(record["camera_height_ratio"], answer.get("scale_sigma"))
    return record
