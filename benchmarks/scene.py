"""Measure ``physic scene`` on worlds with several cameras, and on photos of calibrated rigs.

    python -m benchmarks.scene worlds OUT --names group walk --seed 3 --views 2 4 8
    python -m benchmarks.scene rigs DATA OUT --sets panoptic roundtable --moments 1 --views 2 3 [--given]

Results of single photos are kept in OUT, so that a second run solves only. The baseline is the average of the results
of the single photos, in the frame of the reference camera, aligned by the true cameras.

DATA is the folder of ``benchmarks.truth``; without it, the second command says so and ends. Truth of people on rigs is
triangulated with the true cameras from the photos that the solution did not get.
"""

from __future__ import annotations

import argparse
import itertools
import pickle
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physic_core.body import JOINT_INDEX
from physic_core.metrics import contact_counts, match_by_masks, mpjpe_mm, pa_mpjpe_mm, precision_recall_f1

NAMES = (
    "group",
    "sit_on_chair",
    "walk",
    "sit_side_by_side",
    "hug",
    "lean_on_table",
    "stand_behind_counter",
    "outdoor_steps",
)
SIZE = (480, 360)
LIMBS = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("elbow", "wrist", "knee", "ankle"))
TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
SEEN = 0.2  # confidence of a keypoint that gives truth
APART_M = 0.12  # largest distance of the rays of a keypoint that gives truth, and median of those of a person


def main() -> None:
    """Run a command of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    worlds = commands.add_parser("worlds")
    worlds.add_argument("out", type=Path)
    worlds.add_argument("--names", nargs="+", choices=NAMES, default=NAMES)
    worlds.add_argument("--seed", type=int, default=1)
    worlds.add_argument("--views", type=int, nargs="+", default=[2, 4])
    worlds.set_defaults(run=run_worlds)
    rigs = commands.add_parser("rigs")
    rigs.add_argument("data", type=Path)
    rigs.add_argument("out", type=Path)
    rigs.add_argument("--sets", nargs="+", default=["panoptic", "roundtable"])
    rigs.add_argument("--moments", type=int, default=1)
    rigs.add_argument("--views", type=int, nargs="+", default=[2, 3])
    rigs.add_argument("--given", action="store_true", help="the cameras are known")
    rigs.set_defaults(run=run_rigs)
    given = parser.parse_args()
    given.run(given)


# ---- worlds ----------------------------------------------------------------------------------------------------------


def mock_config() -> Any:
    """Return the mocks with noise of version 4 and labelled surfaces."""
    from physic_core import load_config
    from physic_core.interfaces import INTERFACES

    mocks: dict[str, dict[str, Any]] = {name: {"options": {"version": 4}} for name in INTERFACES}
    mocks["segmenter"]["options"]["surfaces"] = True
    return load_config(preset="mock", flags={"noise": mocks})


def world_seed(name: str, seed: int) -> int:
    """Return the seed of a world, from the seed of a run."""
    return int(np.random.default_rng(seed).integers(0, 1 << 31, len(NAMES))[NAMES.index(name)])


def run_worlds(given: argparse.Namespace) -> None:
    """Print a row for each number of views, and one of the average of single results."""
    from physic_scene import Scene
    from physic_testing.worlds import build_world, view_names

    given.out.mkdir(parents=True, exist_ok=True)
    config = mock_config()
    rows: dict[str, list[dict[str, float]]] = {}
    with Scene(config) as scene:
        for name in given.names:
            seed = world_seed(name, given.seed)
            names = view_names(f"{name}+other", max(given.views))
            worlds = [build_world(view, seed, SIZE) for view in names]
            alone = [
                kept(given.out / f"{view}-{seed}.pkl", lambda world=world: scene.alone(world.image))  # type: ignore[misc]
                for view, world in zip(names, worlds, strict=True)
            ]
            for count in given.views:
                start = time.process_time()
                found = scene.join(alone[:count])
                seconds = time.process_time() - start
                for label, scores in world_scores(found, worlds, alone[:count]).items():
                    rows.setdefault(f"{count} views, {label}", []).append({**scores, "CPU s": seconds})
                print(f"{name} {seed}, {count} views: {len(found.left_out)} skipped", file=sys.stderr, flush=True)
    print_table(rows)


def world_scores(found: Any, worlds: Sequence[Any], alone: Sequence[Any]) -> dict[str, dict[str, float]]:
    """Return the scores of the joint solution, and of the average of the single results."""
    world, result = worlds[found.reference], found.reconstruction
    match = match_by_masks(np.stack([p.mask for p in result.people]), world.masks, min_iou=0.3)
    pairs = list(zip(match.predicted.tolist(), match.truth.tolist(), strict=True))
    of_row = {person.row: person for person in found.people if not person.moved}
    joint, single = [], []
    for row, true in pairs:
        if row not in of_row:
            continue
        fact, touched = world.joints[true, :22].astype(np.float64), world.contact[true]
        joint.append(person_scores(result.people[row].joints, result.people[row].contact, fact, touched))
        number = found.people.index(of_row[row])
        averaged, f1 = [], []
        for camera in found.cameras:
            for i, person in enumerate(camera.people):
                if person == number:
                    own, body = worlds[camera.index].camera, alone[camera.index].people[i]
                    averaged.append(world.camera.to_camera(own.to_room(body.joints.astype(np.float64))))
                    f1.append(person_scores(body.joints, body.contact, fact, touched)["F1"])
        mean = person_scores(np.mean(averaged, axis=0), result.people[row].contact, fact, touched)
        single.append({**mean, "F1": float(np.mean(f1))})
    cameras = [
        camera_scores(c, world.camera.rotation, world.camera.position, worlds[c.index].camera) for c in found.cameras
    ]
    around = mean_of(row for row in cameras if row)
    return {"joint": {**mean_of(joint), **around}, "average of single results": mean_of(single)}


def person_scores(joints: Any, contact: Any, fact: Any, touched: Any) -> dict[str, float]:
    """Return the errors of one person, mm, and the F1 of contact."""
    joints = np.asarray(joints, np.float64)[None, :22]
    factor = float(np.exp(np.median(np.log(fact[:, 2] / joints[0, :, 2]))))
    f1 = precision_recall_f1(contact_counts(np.asarray(contact)[None], np.asarray(touched)[None]))[2]
    return {
        "PA": float(pa_mpjpe_mm(joints, fact[None])[0]),
        "MPJPE": float(mpjpe_mm(joints, fact[None])[0]),
        "after one factor": float(mpjpe_mm(factor * joints, fact[None])[0]),
        "F1": float(f1[0]),
    }


def camera_scores(camera: Any, rotation: Any, position: Any, true: Any) -> dict[str, float]:
    """Return the errors of a camera's rotation and distance relative to the reference; empty for the reference."""
    away = np.linalg.norm(true.position - position)
    if away < 1e-9:
        return {}
    turn = true.rotation @ rotation.T
    angle = np.degrees(np.arccos(np.clip((np.trace(camera.rotation @ turn.T) - 1) / 2, -1, 1)))
    return {"camera deg": float(angle), "distance %": float(100 * abs(np.linalg.norm(camera.centre) / away - 1))}


# ---- rigs ------------------------------------------------------------------------------------------------------------


def run_rigs(given: argparse.Namespace) -> None:
    """Print a row for each set and number of views, and one of the average of single results."""
    from benchmarks.truth.sets import SETS, picture_of
    from physic_core import Intrinsics, load_config
    from physic_core.types import CameraTrust
    from physic_scene import Scene

    given.out.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[dict[str, float]]] = {}
    with Scene(load_config()) as scene:
        for name in given.sets:
            folder = given.data / name
            if not (folder / "cameras.json").is_file():
                print(f"skipped: {folder} has no cameras.json; it is a set of benchmarks.truth", file=sys.stderr)
                continue
            moments = itertools.groupby(SETS[name](folder), key=lambda sample: sample.group)
            for moment, group in itertools.islice(moments, given.moments):
                samples = list(group)
                alone = []
                for sample in samples:

                    def solve(sample: Any = sample) -> Any:
                        photo = picture_of(sample)[..., ::-1].copy()
                        K, (height, width) = sample.K, photo.shape[:2]
                        known = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], width, height)
                        camera = Intrinsics(*known, trust=CameraTrust.KNOWN) if given.given else None
                        return scene.alone(photo, intrinsics=camera)

                    kind = "given" if given.given else "free"
                    alone.append(kept(given.out / f"{name}-{sample.name}-{kind}.pkl", solve))
                    print(f"{name} {sample.name}: {len(alone[-1].people)} people", file=sys.stderr, flush=True)
                for count in given.views:
                    used = list(range(0, len(samples), 2))[:count] if count == 3 else [0, 2][:count]
                    score_moment(f"{name}, {count} views", scene, samples, alone, used, rows)
                    print(f"{name} {moment}, {count} views: done", file=sys.stderr, flush=True)
    print_table(rows)


def score_moment(
    title: str, scene: Any, samples: Sequence[Any], alone: Sequence[Any], used: list[int], rows: dict[str, Any]
) -> None:
    """Add the scores of one moment, solved from some of its photos."""
    from physic_core.errors import InputError

    try:
        found = scene.join([alone[v] for v in used])
    except InputError as error:
        print(f"{title}: {error}", file=sys.stderr)
        return
    cameras = [sample.truth["camera"] for sample in samples]
    held = [v for v in range(len(samples)) if v not in used]
    truth = triangulated_people([alone[v] for v in held], [cameras[v] for v in held])
    own = cameras[used[found.reference]]
    joint, single, scales = [], [], []
    for person in found.people:
        if not person.solved:
            continue
        fact = nearest_truth(person.joints, own, truth)
        if fact is None:
            continue
        joint.append(joint_errors(person.joints, fact))
        averaged = []
        for camera in found.cameras:
            for i, number in enumerate(camera.people):
                if number is not None and found.people[number] is person:
                    body = alone[used[camera.index]].people[i].joints.astype(np.float64)
                    averaged.append(to_camera(own, to_world(cameras[used[camera.index]], body)))
        single.append(joint_errors(np.mean(averaged, axis=0), fact))
        scales.append((np.linalg.norm(person.joints[0]), np.linalg.norm(np.mean(averaged, axis=0)[0]), fact))
    around = []
    for camera in found.cameras:
        true = cameras[used[camera.index]]
        rotation, centre = np.asarray(true.R), -np.asarray(true.R).T @ np.asarray(true.t)
        own_centre = -np.asarray(own.R).T @ np.asarray(own.t)
        around.append(camera_scores(camera, np.asarray(own.R), own_centre, _Camera(rotation, centre)))
    facts = {"people with truth": float(len(joint)), "people": float(len(found.people)), "truth": float(len(truth))}
    scatter = float(np.mean([one["scatter"] for one in truth])) if truth else float("nan")
    rows.setdefault(f"{title}, joint", []).append(
        {**mean_of(joint), **mean_of(row for row in around if row), **facts, "scatter": 1000 * scatter}
    )
    rows.setdefault(f"{title}, average of single results", []).append(mean_of(single))


class _Camera:
    """Rotation and centre of a true camera."""

    def __init__(self, rotation: Any, position: Any) -> None:
        self.rotation, self.position = rotation, position


def to_world(camera: Any, points: Any) -> Any:
    """Transform points (..., 3) of a camera's frame to the rig's frame."""
    return (points - np.asarray(camera.t)) @ np.asarray(camera.R)


def to_camera(camera: Any, points: Any) -> Any:
    """Transform points (..., 3) of the rig's frame to a camera's frame."""
    return points @ np.asarray(camera.R).T + np.asarray(camera.t)


def triangulated_people(results: Sequence[Any], cameras: Sequence[Any]) -> list[dict[str, Any]]:
    """Return keypoints by name in the rig's frame of the people whom at least two photos agree on."""
    names = LIMBS + TRUNK
    detected = []
    for result, camera in zip(results, cameras, strict=True):
        zoom = camera.width / result.intrinsics.width  # a large photo is reduced before it is reconstructed
        skeleton = result.skeleton if not isinstance(result.skeleton, str) else _skeleton(result.skeleton)
        columns = [skeleton.names.index(name) for name in names]
        detected.append(
            [(zoom * (p.keypoints[columns] + 0.5) - 0.5, p.keypoint_confidence[columns]) for p in result.people]
        )
    found: list[dict[str, Any]] = []
    taken: set[tuple[int, int]] = set()
    candidates = []
    for a, b in itertools.combinations(range(len(results)), 2):
        for i, one in enumerate(detected[a]):
            for j, two in enumerate(detected[b]):
                both = (one[1] > SEEN) & (two[1] > SEEN)
                if both.sum() < 4 or not both[-2:].all():
                    continue
                points = np.array(
                    [_two_rays(cameras[a], cameras[b], p, q) for p, q in zip(one[0], two[0], strict=True)]
                )
                gap = float(np.median(points[both, 3]))
                both &= points[:, 3] < APART_M
                if both[-2:].all():
                    candidates.append((gap, a, i, b, j, points[:, :3], both, points[:, 3]))
    for gap, a, i, b, j, points, both, gaps in sorted(candidates, key=lambda c: c[0]):
        if gap > APART_M or (a, i) in taken or (b, j) in taken:
            continue
        taken |= {(a, i), (b, j)}
        found.append(
            {"points": dict(zip(np.array(names)[both], points[both], strict=True)), "scatter": float(gaps[both].mean())}
        )
    return found


def _skeleton(name: str) -> Any:
    from physic_core.types import skeleton_named

    return skeleton_named(name)


def _two_rays(one: Any, two: Any, pixel: Any, other: Any) -> Any:
    """Return the point (3,) nearest to two rays, and their distance, metres."""
    centres = [-np.asarray(c.R).T @ np.asarray(c.t) for c in (one, two)]
    rays = []
    for camera, uv in ((one, pixel), (two, other)):
        ray = np.asarray(camera.R).T @ np.linalg.solve(np.asarray(camera.K), [uv[0], uv[1], 1.0])
        rays.append(ray / np.linalg.norm(ray))
    along = np.linalg.lstsq(np.stack([rays[0], -rays[1]], axis=1), centres[1] - centres[0], rcond=None)[0]
    ends = [c + s * r for c, s, r in zip(centres, along, rays, strict=True)]
    return np.append((ends[0] + ends[1]) / 2, np.linalg.norm(ends[0] - ends[1]))


def nearest_truth(joints: Any, camera: Any, truth: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the true points, camera's frame, of the person whose direction is nearest; None beyond 4 degrees."""
    best, least = None, np.cos(np.radians(4.0))
    own = joints[0] / np.linalg.norm(joints[0])
    for person in truth:
        points = {name: to_camera(camera, point) for name, point in person["points"].items()}
        pelvis = (points["left_hip"] + points["right_hip"]) / 2
        cosine = float(own @ pelvis / np.linalg.norm(pelvis))
        if cosine > least:
            best, least = points, cosine
    return best


def joint_errors(joints: Any, fact: Mapping[str, Any]) -> dict[str, float]:
    """Return the errors of hips' middle and limbs, mm, and of the distance, %."""
    hips = (joints[JOINT_INDEX["left_hip"]] + joints[JOINT_INDEX["right_hip"]]) / 2
    true = (fact["left_hip"] + fact["right_hip"]) / 2
    limbs = [np.linalg.norm(joints[JOINT_INDEX[name]] - fact[name]) for name in LIMBS if name in fact]
    rooted = [np.linalg.norm(joints[JOINT_INDEX[name]] - hips - fact[name] + true) for name in LIMBS if name in fact]
    return {
        "pelvis": 1000 * float(np.linalg.norm(hips - true)),
        "limbs": 1000 * float(np.mean(limbs)) if limbs else float("nan"),
        "limbs, root-aligned": 1000 * float(np.mean(rooted)) if rooted else float("nan"),
        "scale %": 100 * float(abs(np.linalg.norm(hips) / np.linalg.norm(true) - 1)),
    }


# ---- both ------------------------------------------------------------------------------------------------------------


def kept(path: Path, make: Any) -> Any:
    """Return the result of a single photo, from a file of an earlier run if there is one."""
    if path.is_file():
        return pickle.loads(path.read_bytes())  # of this script's own folder
    made = make()
    path.with_suffix(".tmp").write_bytes(pickle.dumps(made))
    path.with_suffix(".tmp").rename(path)
    return made


def mean_of(rows: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of each number."""
    taken = list(rows)
    return {key: float(np.nanmean([row[key] for row in taken])) for key in (taken[0] if taken else {})}


def print_table(rows: Mapping[str, Sequence[Mapping[str, float]]]) -> None:
    """Print a Markdown table of means over worlds or moments."""
    columns = list(dict.fromkeys(key for scores in rows.values() for row in scores for key in row))
    print("|", " | ".join(["", "n", *columns]), "|")
    print("|", " | ".join(["---"] * (len(columns) + 2)), "|")
    for name, scores in rows.items():
        found = []
        for column in columns:
            values = [row[column] for row in scores if column in row]
            found.append(f"{np.mean(values):.3g}" if values else "-")
        print("|", " | ".join([name, str(len(scores)), *found]), "|")


if __name__ == "__main__":
    main()
