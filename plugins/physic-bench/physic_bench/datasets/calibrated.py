"""Photos of your own with known cameras: one view with measured joints, or several views of one
moment.

ROOT holds the photos, and either truth.json, a list of photos:

    [{"image": "a.jpg", "width": 1920, "height": 1080, "K": 3 x 3 px, "dist": [k1, k2, p1, p2, k3],
      "joints": {"left_hip": [x, y, z], ...} in m in the camera frame, or "people": [{"joints":
      {...}}, ...], "up": [x, y, z] or null, "floor_point": [x, y, z] or null, "sequence": "..."},
      ...]

or cameras.json, with photos CAMERA_MOMENT.jpg, or CAMERA.jpg where there is one moment:

    {"cameras": {"left": {"width", "height", "K", "dist", "R": 3 x 3, "t_m": 3}, ...}, "up": [x, y,
    z] or no "up"}

X_camera = R X_world + t_m; the floor is at the origin of the world. joints.json may have the joints
of each moment in the world, {"MOMENT": [{"left_hip": [x, y, z], ...}, ...]}.

Pictures are undistorted before they are reconstructed, and the camera is given. Names of joints are
SMPL-X's; l_ and r_ stand for left_ and right_. Without joints.json, joints are triangulated from
the 2D keypoints of the first method, from at least three views: that truth shares errors with the
method that it judges.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.cameras import Camera, calibrated
from physic_bench.contract import BenchPerson, Frame, Picture, Truth
from physic_bench.datasets.base import DataSet, FrameSet
from physic_bench.joints import LIMB_JOINTS, full_names, limb_joints
from physic_bench.reading import numbers, read_json, reading
from physic_bench.triangulation import match_views, visible_joints

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.bodies import BodyFiles
    from physic_bench.contract import Prediction

    Array = NDArray[np.float64]

MIN_VISIBLE = 8
"""Joints in the picture from which somebody of a multi-view set counts as visible in a view."""

SUFFIXES = (".jpg", ".jpeg", ".png")


def missing(root: Path, pictures: bool) -> list[str]:
    """Return the missing files."""
    truth = root / "truth.json"
    cameras = root / "cameras.json"
    if truth.is_file():
        with reading(truth):
            paths = [root / record["image"] for record in read_json(truth)]
        return [f"{path}: the photo is not there" for path in paths if not path.is_file()]
    if not cameras.is_file():
        return [f"{root}: has neither truth.json nor cameras.json"]
    with reading(cameras):
        names = list(read_json(cameras)["cameras"])
    return [
        f"{root}/{name}*.jpg: no photo of camera '{name}'"
        for name in names
        if not _photos(root, name)
    ]


def frames(root: Path, choose: Callable[[list[str]], list[str]], bodies: BodyFiles) -> FrameSet:
    """Return the photos."""
    truth = root / "truth.json"
    cameras = root / "cameras.json"
    if not truth.is_file():
        with reading(cameras):
            return _views(root, choose, read_json(cameras))
    with reading(truth):
        every = {Path(record["image"]).stem: _single(root, record) for record in read_json(truth)}
    return FrameSet(tuple(every[name] for name in choose(list(every))))


def _single(root: Path, record: Mapping[str, Any]) -> Frame:
    K = numbers(record["K"], (3, 3), "K")
    camera = Camera(
        K, int(record["width"]), int(record["height"]), distortion=_distortion(record.get("dist"))
    )
    people = [{"joints": record["joints"]}] if "joints" in record else record["people"]
    up = record.get("up")
    height = float("nan")
    up = None if up is None else numbers(up, (3,), "up")
    if up is not None and record.get("floor_point") is not None:
        height = -float(up @ numbers(record["floor_point"], (3,), "floor_point"))
    persons = []
    for i, person in enumerate(people):
        named = full_names(person["joints"])
        joints = numbers([list(place) for place in named.values()], (len(named), 3), "joints")
        persons.append(BenchPerson(str(i), joints, tuple(named), "measured"))
    found = Truth(tuple(persons), up=up, camera_height=height)
    stem = Path(record["image"]).stem
    return Frame(
        stem,
        str(record.get("sequence", stem)),
        lambda: found,
        camera,
        Picture(root / record["image"]),
    )


def _views(
    root: Path, choose: Callable[[list[str]], list[str]], document: Mapping[str, Any]
) -> FrameSet:
    up = None if document.get("up") is None else numbers(document["up"], (3,), "up")
    up = None if up is None else up / np.linalg.norm(up)
    measured = read_json(root / "joints.json") if (root / "joints.json").is_file() else {}
    every: dict[str, Frame] = {}
    for name, record in document["cameras"].items():
        camera, shown = calibrated(record)
        camera = replace(camera, distortion=_distortion(record["dist"]))
        crop = None if shown == (0, 0, int(record["width"]), int(record["height"])) else shown
        for photo in _photos(root, name):
            moment = photo.stem[len(name) + 1 :] or "0"
            people = [limb_joints(joints, 3) for joints in measured.get(moment, ())]
            load = partial(_truth_of_view, camera, people, up, "measured")
            every[photo.stem] = Frame(
                photo.stem, moment, load, camera, Picture(photo, crop=crop), moment
            )
    kept = tuple(
        every[name] for name in choose(sorted(every, key=lambda name: (every[name].group, name)))
    )
    notes = (
        ()
        if up is not None
        else ("up is not known (no 'up' in cameras.json): floors are not measured",)
    )
    lacking = {frame.group for frame in kept} - set(measured)
    return FrameSet(
        kept, notes, completed=partial(_triangulated, kept, notes, lacking, up) if lacking else None
    )


def _triangulated(
    frames: Sequence[Frame],
    notes: tuple[str, ...],
    lacking: set[str],
    up: Array | None,
    results: Mapping[str, Prediction | None],
    method: str,
) -> FrameSet:
    """Return the frames with the joints of each moment without measured ones, from the 2D keypoints
    of results.
    """
    found = []
    total = 0
    for moment, group in groupby(
        sorted(frames, key=lambda frame: frame.group), key=lambda frame: frame.group
    ):
        views = list(group)
        if moment in lacking:
            seen = [() if (r := results.get(f.id)) is None else r.people for f in views]
            keypoints = [
                [p.keypoints for p in people if p.keypoints is not None] for people in seen
            ]
            people = [person.joints for person in match_views([f.camera for f in views], keypoints)]
            total += len(people)
            source = "triangulated from 2D keypoints"
            views = [
                replace(f, truth=partial(_truth_of_view, f.camera, people, up, source))
                for f in views
            ]
        found += views
    note = (
        f"joints of {total} people are triangulated from 2D keypoints of {method}: no "
        f"independent truth"
    )
    return FrameSet(tuple(found), (*notes, note))


def _truth_of_view(camera: Camera, people: Sequence[Array], up: Array | None, source: str) -> Truth:
    shown = [
        BenchPerson(str(i), camera.in_camera(joints), LIMB_JOINTS, source)
        for i, joints in enumerate(people)
        if visible_joints(camera, joints).sum()
        >= min(MIN_VISIBLE, int(np.isfinite(joints).all(-1).sum()))
    ]
    if up is None:
        return Truth(tuple(shown))
    return Truth(tuple(shown), up=camera.R @ up, camera_height=float(camera.centre @ up))


def _photos(root: Path, camera: str) -> list[Path]:
    return sorted(
        path
        for path in root.iterdir()
        if path.suffix.lower() in SUFFIXES
        and (path.stem == camera or path.stem.startswith(f"{camera}_"))
    )


def _distortion(given: Any) -> tuple[float, float, float, float, float]:
    k1, k2, p1, p2, *k3 = numbers([0.0] * 5 if given is None else given, (-1,), "dist").tolist()
    return k1, k2, p1, p2, k3[0] if k3 else 0.0


DATA_SET = DataSet("calibrated", __doc__, missing, frames)
