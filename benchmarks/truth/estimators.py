"""Errors of a preset's estimators on real photos with measured truth, beside those that the mocks draw on worlds.

    python -m benchmarks.truth.estimators DATA ... --out estimator-errors [--preset embedded] [--photos N]
    python -m benchmarks.truth.estimators --worlds 40 --out estimator-errors

The first runs the estimators on every photo, without the engine, and keeps their results in ``--out/evidence``, so that
an interrupted run continues: use a new folder for another version of the code. The second runs the mocks on worlds.
Both print the same statistics, by which the noise of the mocks was chosen.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_bench.joints import limb_joints
from physic_bench.triangulation import Triangulated, match_views, robust_joints

from .__main__ import samples_of, without_nan
from .arguments import add_arguments_of_photos
from .measures import box_of
from .scores import LIMBS, SEEN
from .sets import Sample, camera_of, picture_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.truth.estimator_errors import PhotoTruth
    from physic_core.pipeline.estimate import Estimates

    Array = NDArray[np.float64]

MIN_OTHER_VIEWS = 2
"""A joint is held against what other views than the own one triangulate, so that no keypoint is its own truth."""

NO_VISIBILITY = ("posetrack18",)
"""Data sets of people2d that call every annotated joint hidden."""


def main() -> int:
    """Run, compare, print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.truth.estimators", description=(__doc__ or "").partition("\n")[0]
    )
    add_arguments_of_photos(parser, Path("estimator-errors"))
    parser.add_argument("--no-run", action="store_true", help="only the photos whose evidence --out holds already")
    parser.add_argument("--worlds", type=int, default=0, metavar="N", help="measure the mocks on N worlds instead")
    parser.add_argument("--seed", type=int, default=0, help="draws the worlds")
    given = parser.parse_args()
    from benchmarks.truth.estimator_statistics import statistics_of, text_of

    if given.worlds:
        records, name = world_records(given.worlds, given.seed, given.settings), "worlds"
    else:
        samples = samples_of(given.data, given.sets.split(","), given.photos, None)
        records, name = photo_records(samples, given), "photos"
    figures = statistics_of(records)
    given.out.mkdir(parents=True, exist_ok=True)
    document = {"figures": {key: asdict(figure) for key, figure in figures.items()}, "records": records}
    (given.out / f"{name}.json").write_text(json.dumps(without_nan(document), indent=1, allow_nan=False))
    print(text_of(figures))
    return 0


def photo_records(samples: Sequence[Sample], given: argparse.Namespace) -> dict[str, list[dict[str, Any]]]:
    """The records of all photos whose estimators gave a result, by kind."""
    from benchmarks.truth.estimator_errors import estimator_records
    from physic_core.body import load_body
    from physic_core.errors import PhysicError

    model = load_body("embedded")
    found: list[tuple[Sample, Estimates]] = []
    for sample in samples:
        try:
            estimates = evidence_of(sample, given)
        except PhysicError as error:
            print(f"{sample.set} {sample.name}: {error}", file=sys.stderr, flush=True)
            continue
        if estimates is not None:
            found.append((sample, estimates))
    if nobody := [f"{s.set} {s.name}" for s, e in found if not len(e.people)]:
        print(f"nobody found, skipped: {', '.join(nobody)}", file=sys.stderr)
    kinds: dict[str, list[dict[str, Any]]] = {}
    for sample, estimates, truth in with_truth([(s, e) for s, e in found if len(e.people)]):
        for kind, records in estimator_records(estimates, truth, model).items():
            labelled = [{"set": sample.set, "group": sample.group, "photo": sample.name, **r} for r in records]
            kinds.setdefault(kind, []).extend(labelled)
    return kinds


def evidence_of(sample: Sample, given: argparse.Namespace) -> Estimates | None:
    """The estimators' results that an earlier run left, or new ones; None where none are to be made."""
    from physic_bench.worlds.evidence_file import load_evidence, save_evidence

    file = given.out / "evidence" / sample.set / f"{sample.name}.npz"
    known = load_evidence(file) if file.exists() else None
    if known is not None or given.no_run:
        return known
    file.parent.mkdir(parents=True, exist_ok=True)
    estimates = run_estimators(sample, given.preset, given.settings)
    save_evidence(file, estimates)
    print(sample.set, sample.name, file=sys.stderr, flush=True)
    return estimates


def run_estimators(sample: Sample, preset: str, settings: Sequence[str]) -> Estimates:
    """Run the backends of a preset on one sample, with its camera where that is known."""
    from physic_core import load_config
    from physic_core.body import load_body
    from physic_core.configuration.resolve import require_available, resolve
    from physic_core.discovery.plugins import discover
    from physic_core.io.photo import Photo, limit_size
    from physic_core.pipeline.estimate import run_backends
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import CameraTrust, Intrinsics

    plan = resolve(load_config(preset=preset, overrides=list(settings)), discover())
    require_available(plan)
    image = np.ascontiguousarray(picture_of(sample)[..., ::-1])
    camera = None
    if sample.K is not None:
        K, (height, width) = np.asarray(sample.K), image.shape[:2]
        camera = Intrinsics(K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height, "given", CameraTrust.KNOWN)
    photo = limit_size(Photo(image, camera), plan.photo.max_side)
    stages = StageRunner(plan.device, len(plan.backends))
    try:
        return run_backends(photo.image, photo.intrinsics, plan, lambda: load_body(plan.body_model), stages)
    finally:
        stages.close()


def with_truth(found: Sequence[tuple[Sample, Estimates]]) -> Iterator[tuple[Sample, Estimates, PhotoTruth]]:
    """Each photo with what is known of it, in px of the picture that the estimators got."""
    moments: dict[str, list[tuple[Sample, Estimates]]] = {}
    for sample, estimates in found:
        if "camera" in sample.truth:
            moments.setdefault(f"{sample.set}/{sample.group}", []).append((sample, estimates))
        elif sample.set == "mpi_inf_3dhp":
            yield sample, estimates, single_truth(sample, estimates)
        elif sample.set == "people2d":
            yield sample, estimates, annotated_truth(sample, estimates)
        elif sample.set == "parkour":
            yield sample, estimates, parkour_truth(sample, estimates)
    for views in moments.values():
        yield from moment_truth(views)


def single_truth(sample: Sample, estimates: Estimates) -> PhotoTruth:
    """Of mpi_inf_3dhp: joints, and floor where it is known. What is hidden is not known."""
    from benchmarks.truth.estimator_errors import PhotoTruth

    joints = limb_joints(sample.truth["joints"], 3)
    points = joints @ np.array(sample.truth["K"]).T
    points = resized(points[:, :2] / points[:, 2:], (sample.truth["width"], sample.truth["height"]), estimates)
    up = sample.truth["up"]
    height = float("nan") if up is None else -float(np.array(up) @ np.array(sample.truth["floor_point"]))
    return PhotoTruth(
        points=points[None],
        seen=np.full((1, 12), np.nan),
        boxes=box_of(points)[None],
        joints=joints[None],
        complete=True,
        up=None if up is None else np.array(up, np.float64),
        camera_height=height,
    )


def annotated_truth(sample: Sample, estimates: Estimates) -> PhotoTruth:
    """Of people2d: keypoints with what is hidden, and boxes; some photos show more people than are annotated."""
    from benchmarks.truth.estimator_errors import PhotoTruth

    everybody = sample.truth["people"]
    height, width = picture_of(sample).shape[:2]
    marks = np.stack([limb_joints(person["keypoints"], 3) for person in everybody])
    known = marks[..., 2:] > 0
    hidden_known = sample.truth["set"] not in NO_VISIBILITY
    boxes = np.array([[x, y, x + w, y + h] for x, y, w, h in (person["box_xywh"] for person in everybody)], np.float64)
    corners = resized(boxes.reshape(-1, 2), (width, height), estimates).reshape(-1, 4)
    return PhotoTruth(
        points=resized(np.where(known, marks[..., :2], np.nan), (width, height), estimates),
        seen=np.where(known[..., 0] & hidden_known, marks[..., 2] - 1, np.nan),
        boxes=corners,
        joints=np.full((len(marks), 12, 3), np.nan),
    )


def parkour_truth(sample: Sample, estimates: Estimates) -> PhotoTruth:
    """Of parkour: joints of one person in a frame of their own, and which limbs touch. The largest person is theirs."""
    from benchmarks.truth.estimator_errors import PhotoTruth, limb_points

    areas = [(b[2] - b[0]) * (b[3] - b[1]) for b in np.asarray(estimates.people.boxes, np.float64)]
    own = int(np.argmax(areas))
    points, _ = limb_points(estimates.keypoints)
    touches = {
        name: bool(sample.truth["touches"][limb])
        for limb, name in LIMBS.items()
        if not sample.truth["uncaptured"][limb]
    }
    return PhotoTruth(
        points=points[own][None],
        seen=np.full((1, 12), np.nan),
        boxes=np.asarray(estimates.people.boxes, np.float64)[own][None],
        joints=limb_joints(sample.truth["joints"], 3)[None],
        camera_known=False,
        points_known=False,
        touches=(touches,),
    )


def moment_truth(views: Sequence[tuple[Sample, Estimates]]) -> Iterator[tuple[Sample, Estimates, PhotoTruth]]:
    """Of several cameras: joints that the other views of the moment triangulate, and the calibrated floor."""
    from benchmarks.truth.estimator_errors import PhotoTruth, limb_points

    cameras = [camera_of(sample) for sample, _ in views]
    detections = []
    for camera, (_, estimates) in zip(cameras, views, strict=True):
        points, confidence = limb_points(estimates.keypoints)
        height, width = estimates.image.shape[:2]
        factor = np.array([camera.width / width, camera.height / height])
        points = (points + 0.5) * factor - 0.5
        detections.append(list(np.where(confidence[..., None] >= SEEN, points, np.nan)))
    people = match_views(cameras, detections)
    for v, (camera, (sample, estimates)) in enumerate(zip(cameras, views, strict=True)):
        worlds = [
            joints for person in people if (joints := _by_other_views(person, v, cameras, detections)) is not None
        ]
        joints = np.array([camera.in_camera(j) for j in worlds]).reshape(-1, 12, 3)
        size = (camera.width, camera.height)
        points = np.array([camera.project(j) for j in worlds]).reshape(-1, 12, 2)
        inside = ((points > 0) & (points < size)).all(-1)
        shown = inside.sum(1) >= 8
        points = resized(np.where(inside[..., None], points, np.nan)[shown], size, estimates)
        yield (
            sample,
            estimates,
            PhotoTruth(
                points=points,
                seen=np.full(points.shape[:2], np.nan),
                boxes=np.array([box_of(p) for p in points]).reshape(-1, 4),
                joints=joints[shown],
                up=camera.R @ sample.truth["up"],
                camera_height=float(camera.centre @ sample.truth["up"]),
            ),
        )


def _by_other_views(person: Triangulated, v: int, cameras: Sequence[Any], detections: Sequence[Any]) -> Array | None:
    """(12, 3) m of the world, without view ``v``; None where fewer than two others see the person."""
    others = [w for w in person.members if w != v]
    if len(others) < MIN_OTHER_VIEWS:
        return None
    joints, _ = robust_joints(
        [cameras[w] for w in others], np.stack([detections[w][person.members[w]] for w in others])
    )
    return joints if np.isfinite(joints).all(-1).sum() >= 8 else None


def resized(points: Array, size: tuple[int, int], estimates: Estimates) -> Array:
    """Points (..., 2) px of a picture of ``size`` (width, height) in px of the picture that the estimators got."""
    height, width = estimates.image.shape[:2]
    moved: Array = (points + 0.5) * (np.array([width, height]) / np.array(size)) - 0.5
    return moved


def world_records(count: int, seed: int, settings: Sequence[str]) -> dict[str, list[Mapping[str, Any]]]:
    """The records of the mocks on worlds, by kind; the camera is given, as for the photos."""
    from benchmarks.truth.estimator_errors import estimator_records, world_truth
    from physic_core import load_config
    from physic_core.body import load_body
    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover
    from physic_core.interfaces import INTERFACES
    from physic_core.pipeline.estimate import run_backends
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_core.types import CameraTrust
    from physic_testing.worlds import benchmark_worlds, build_world

    options = [f"{name}.options.noise=1" for name in INTERFACES]
    plan = resolve(load_config(preset="mock", overrides=[*options, *settings]), discover())
    model = load_body(plan.body_model)
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for name, number in benchmark_worlds(count, seed):
        world = build_world(name, number, (320, 240))
        camera = replace(world.intrinsics, trust=CameraTrust.KNOWN)
        estimates = run_backends(world.image, camera, plan, lambda: model, StageRunner(plan.device, len(plan.backends)))
        for kind, records in estimator_records(estimates, world_truth(world, model), model).items():
            labelled = [
                {"set": "worlds", "group": f"{name} {number}", "photo": f"{name} {number}", **r} for r in records
            ]
            kinds.setdefault(kind, []).extend(labelled)
    return kinds


if __name__ == "__main__":
    sys.exit(main())
