"""Photos with known cameras: one view with measured joints (truth.json), or several views (cameras.json)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from physic_bench.cameras import Camera, calibrated
from physic_bench.contract import Frame, Picture, TruePerson, Truth
from physic_bench.datasets.base import DataSet, DataSource, Description, FrameSet, NoOptions, evenly
from physic_bench.joints import LIMB_JOINTS, full_names, is_upright, limb_joints
from physic_bench.triangulation import match_views, visible_joints
from physic_bench.wording import counted
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles
    from physic_bench.contract import Prediction

    Array = NDArray[np.float64]

MIN_VISIBLE = 8
"""Joints in the picture from which somebody of a multi-view set counts as visible in a view."""

SUFFIXES = (".jpg", ".jpeg", ".png")

TREE = """\
ROOT/
  truth.json        a list of photos: [{"image": "a.jpg", "width": 1920, "height": 1080, "K": 3 x 3 px,
                      "dist": [k1, k2, p1, p2, k3], "joints": {"left_hip": [x, y, z], ...} in m in the camera frame,
                      "up": [x, y, z] or null, "floor_point": [x, y, z] or null, "sequence": "...", "action": "..."}]
                      "people": [{"joints": {...}}, ...] instead of "joints" for several people
  a.jpg ...
or
ROOT/
  cameras.json      {"cameras": {"left": {"width", "height", "K", "dist", "R": 3 x 3, "t_m": 3}, ...},
                      "up": [x, y, z] of the world, or no "up"}; X_camera = R X_world + t_m; the floor is at the origin
  joints.json       optional: {"MOMENT": [{"left_hip": [x, y, z] in m in the world, ...}, ...]}
  left_MOMENT.jpg   one photo per camera and moment; CAMERA.jpg where there is one moment"""


class Calibrated(DataSet):
    """Reads truth.json and cameras.json."""

    name: ClassVar[str] = "calibrated"
    summary: ClassVar[str] = "your own photos with known cameras"

    def describe(self) -> Description:
        """Return how to write such a folder."""
        return Description(
            "Photos of your own with known cameras, with measured joints or from several views.",
            (DataSource("photos and calibration", "your laboratory", "yours"),),
            TREE,
            (
                "Pictures are undistorted before they are reconstructed, and the camera is given.",
                "Joints are compared by name: 22 body joints if all are there, else shoulders, elbows, wrists, hips, "
                "knees and ankles. Names are SMPL-X's; l_ and r_ stand for left_ and right_.",
                "Without joints.json, joints of several views are triangulated from the 2D keypoints of the first "
                "method: robustly, from at least three views. That truth shares errors with the method that it judges.",
                "The spread of one pelvis over the views needs no truth.",
            ),
        )

    def check(self, root: Path, options: NoOptions, *, pictures: bool = True) -> list[str]:
        """Return the missing files."""
        if (root / "truth.json").is_file():
            records = _json(root / "truth.json")
            if not isinstance(records, list):
                return [f"{root / 'truth.json'}: must hold a list of photos, got a {type(records).__name__}"]
            return [problem for i, record in enumerate(records) for problem in _record_problems(root, i, record)]
        if not (root / "cameras.json").is_file():
            return [f"{root}: has neither truth.json nor cameras.json"]
        cameras = _json(root / "cameras.json").get("cameras", {})
        missing = [
            f"{root / 'cameras.json'}: camera '{name}' has no {key}"
            for name, record in cameras.items()
            for key in ("width", "height", "dist", "R", "t_m")
            if key not in record
        ]
        missing += [f"{root}/{name}*.jpg: no photo of camera '{name}'" for name in cameras if not _photos(root, name)]
        return missing or ([] if cameras else [f"{root / 'cameras.json'}: names no camera under 'cameras'"])

    def frames(self, root: Path, options: NoOptions, bodies: BodyFiles, limit: int | None = None) -> FrameSet:
        """Return the photos; all views of a moment, or none."""
        if (root / "truth.json").is_file():
            return FrameSet(tuple(_single(root, record) for record in evenly(_json(root / "truth.json"), limit)))
        return self._views(root, limit)

    def _views(self, root: Path, limit: int | None) -> FrameSet:
        document = _json(root / "cameras.json")
        up = _up(document.get("up"))
        moments = _json(root / "joints.json") if (root / "joints.json").is_file() else {}
        frames = []
        for name, record in document["cameras"].items():
            camera, shown = calibrated(record)
            camera = replace(camera, distortion=_distortion(record["dist"]))
            for photo in _photos(root, name):
                moment = photo.stem[len(name) + 1 :] or "0"
                everybody = [limb_joints(joints, 3) for joints in moments.get(moment, ())]
                picture = Picture(photo, crop=None if shown == _whole(record) else shown)
                frames.append(
                    Frame(
                        photo.stem,
                        moment,
                        partial(_truth_of_view, camera, tuple(everybody), up),
                        camera,
                        picture,
                        group=moment,
                    )
                )
        notes = () if up is not None else ("up is not known (no 'up' in cameras.json): floors are not measured",)
        count = None if limit is None else max(limit // len(document["cameras"]), 1)
        chosen = evenly(sorted({frame.group for frame in frames}), count)
        kept = [frame for frame in frames if frame.group in chosen]
        return FrameSet(tuple(sorted(kept, key=lambda f: (f.group, f.id))), notes)

    def needs_results(self, found: FrameSet) -> bool:
        """Return whether some views have no joints."""
        return any(frame.group and not frame.truth().people for frame in found.frames)

    def complete(self, found: FrameSet, results: Mapping[str, Prediction | None], method: str, root: Path) -> FrameSet:
        """Triangulate the joints of each moment without measured ones, from the 2D keypoints of the results."""
        moments: dict[str, list[Frame]] = {}
        for frame in found.frames:
            moments.setdefault(frame.group, []).append(frame)
        frames, notes, total = [], list(found.notes), 0
        for views in moments.values():
            if any(frame.truth().people for frame in views):
                frames += views
                continue
            cameras = [frame.camera for frame in views]
            keypoints = [_keypoints(results.get(frame.id)) for frame in views]
            people = tuple(person.joints for person in match_views(cameras, keypoints))
            total += len(people)
            frames += [replace(f, truth=partial(_with_people, f.truth, f.camera, people)) for f in views]
        who = counted(total, "person", "people")
        notes.append(f"joints of {who} are triangulated from 2D keypoints of {method}: no independent truth")
        return FrameSet(tuple(frames), tuple(notes), found.left_out)


def _single(root: Path, record: Mapping[str, Any]) -> Frame:
    camera = Camera(
        np.array(record["K"], np.float64),
        int(record["width"]),
        int(record["height"]),
        distortion=_distortion(record.get("dist")),
    )
    stem = Path(record["image"]).stem
    labels = {key: str(record[key]) for key in ("action", "occlusion") if record.get(key) is not None}
    load = partial(_truth_of_record, _people(record), record.get("up"), record.get("floor_point"))
    return Frame(stem, str(record.get("sequence", stem)), load, camera, Picture(root / record["image"]), labels)


def _people(record: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"joints": record["joints"]}] if "joints" in record else list(record["people"])


def _truth_of_record(people: Sequence[Mapping[str, Any]], up: Any, floor_point: Any) -> Truth:
    direction = None if up is None else np.array(up, np.float64)
    height = float("nan")
    if direction is not None and floor_point is not None:
        height = -float(direction @ np.array(floor_point, np.float64))
    persons = []
    for i, person in enumerate(people):
        named = full_names(person["joints"])
        joints = np.array([list(place) for place in named.values()], np.float64)
        posture = is_upright(limb_joints(person["joints"], 3), direction)
        labels = {"posture": {True: "upright", False: "bent", None: "unknown"}[posture]}
        persons.append(TruePerson(str(i), joints, tuple(named), "measured", labels=labels))
    return Truth(tuple(persons), up=direction, camera_height=height)


def _truth_of_view(camera: Camera, people: tuple[Array, ...], up: Array | None) -> Truth:
    shown = [
        TruePerson(str(i), camera.in_camera(joints), LIMB_JOINTS, "measured")
        for i, joints in enumerate(people)
        if visible_joints(camera, joints).sum() >= min(MIN_VISIBLE, int(np.isfinite(joints).all(-1).sum()))
    ]
    if up is None:
        return Truth(tuple(shown))
    return Truth(tuple(shown), up=camera.R @ up, camera_height=float(camera.centre @ up))


def _with_people(load: Any, camera: Camera, people: tuple[Array, ...]) -> Truth:
    truth: Truth = load()
    found = _truth_of_view(camera, people, None).people
    return replace(truth, people=tuple(replace(p, joint_source="triangulated from 2D keypoints") for p in found))


def _keypoints(prediction: Prediction | None) -> list[Array]:
    if prediction is None:
        return []
    return [person.keypoints for person in prediction.people if person.keypoints is not None]


def _record_problems(root: Path, i: int, record: Any) -> list[str]:
    where = f"{root / 'truth.json'}, photo {i + 1}"
    if not isinstance(record, dict):
        return [f"{where}: must be an object, got a {type(record).__name__}"]
    problems = [f"{where}: there is no '{key}'" for key in ("image", "width", "height", "K") if key not in record]
    if "joints" not in record and "people" not in record:
        problems.append(f"{where}: there is no 'joints' or 'people'")
    if "K" in record and np.shape(record["K"]) != (3, 3):
        problems.append(f"{where}: 'K' must be 3 x 3, got {np.shape(record['K'])}")
    if "image" in record and not (root / record["image"]).is_file():
        problems.append(f"{root / record['image']}: the photo is not there")
    return problems


def _photos(root: Path, camera: str) -> list[Path]:
    return sorted(
        path
        for path in root.iterdir()
        if path.suffix.lower() in SUFFIXES and (path.stem == camera or path.stem.startswith(f"{camera}_"))
    )


def _whole(record: Mapping[str, Any]) -> tuple[int, int, int, int]:
    return 0, 0, int(record["width"]), int(record["height"])


def _distortion(given: Any) -> tuple[float, float, float, float, float]:
    values = [0.0] * 5 if given is None else [float(v) for v in given]
    if len(values) not in (4, 5):
        raise InputError(f"distortion must be k1, k2, p1, p2, k3, got {len(values)} numbers")
    k1, k2, p1, p2, *k3 = values
    return k1, k2, p1, p2, k3[0] if k3 else 0.0


def _up(given: Any) -> Array | None:
    if given is None:
        return None
    direction = np.array(given, np.float64)
    if direction.shape != (3,) or not np.linalg.norm(direction) > 0:
        raise InputError(f"up must be three numbers that are not all zero, got {direction.tolist()}")
    unit: Array = direction / np.linalg.norm(direction)
    return unit


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON ({error}): it is damaged or truncated") from error


DATA_SET = Calibrated()
