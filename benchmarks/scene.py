"""Measure ``physic scene`` on worlds with several cameras, and on photos of calibrated rigs.

    python -m benchmarks.scene worlds OUT --names group walk --seed 3 --views 2 4 8
    python -m benchmarks.scene rigs DATA OUT --kinds pairs fours wrong --most 60

Results of single photos are kept in OUT, so that a second run solves only. The baseline of worlds
is the average of the results of the single photos, in the frame of the reference camera, aligned by
the true cameras.

DATA is the folder of ``benchmarks.truth``, whose sets ``panoptic`` and ``roundtable`` are used;
without it, the second command says so and ends (``benchmarks/scene_rigs.py``).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physic_bench.kept import kept
from physic_bench.worlds.world_evidence import noisy_config
from physic_core.metrics import (
    contact_counts,
    markdown_table,
    match_by_masks,
    mpjpe_mm,
    pa_mpjpe_mm,
    precision_recall_f1,
)

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


def main() -> None:
    """Run a command of this file."""
    from benchmarks.scene_rigs import run_rigs

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
    rigs.add_argument(
        "--kinds", nargs="+", choices=("pairs", "fours", "wrong"), default=("pairs", "wrong")
    )
    rigs.add_argument("--most", type=int, default=60, help="moments of each kind, spread over all")
    rigs.add_argument(
        "--apart", action="store_true", help="only moments that took no part in choosing numbers"
    )
    rigs.set_defaults(
        run=lambda given: run_rigs(
            given.data, given.out, given.kinds, given.most, apart=given.apart
        )
    )
    given = parser.parse_args()
    given.run(given)


# ---- worlds
# --------------------------------------------------------------------------------------------------


def world_seed(name: str, seed: int) -> int:
    """Return the seed of a world, from the seed of a run."""
    return int(np.random.default_rng(seed).integers(0, 1 << 31, len(NAMES))[NAMES.index(name)])


def run_worlds(given: argparse.Namespace) -> None:
    """Print a row for each number of views, and one of the average of single results."""
    from physic_scene import ScenePipeline
    from physic_testing.worlds import build_world, view_names

    given.out.mkdir(parents=True, exist_ok=True)
    config = noisy_config()
    rows: dict[str, list[dict[str, float]]] = {}
    with ScenePipeline(config) as scene:
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
                    rows.setdefault(f"{count} views, {label}", []).append(
                        {**scores, "CPU s": seconds}
                    )
                print(
                    f"{name} {seed}, {count} views: {len(found.left_out)} skipped",
                    file=sys.stderr,
                    flush=True,
                )
    print_table(rows)


def world_scores(
    found: Any, worlds: Sequence[Any], alone: Sequence[Any]
) -> dict[str, dict[str, float]]:
    """Return the scores of the joint solution, and of the average of the single results."""
    world = worlds[found.reference]
    result = found.reconstruction
    match = match_by_masks(np.stack([p.mask for p in result.people]), world.masks, min_iou=0.3)
    pairs = list(zip(match.predicted.tolist(), match.truth.tolist(), strict=True))
    joint = []
    single = []
    for row, true in pairs:
        fact = world.joints[true, :22].astype(np.float64)
        touched = world.contact[true]
        averaged = []
        f1 = []
        for photo in found.photos:
            if row in photo.shown:
                own = worlds[photo.index].camera
                body = alone[photo.index].people[photo.shown[row]]
                averaged.append(world.camera.to_camera(own.to_room(body.joints.astype(np.float64))))
                f1.append(person_scores(body.joints, body.contact, fact, touched)["F1"])
        if len(averaged) < 2:
            continue
        joint.append(
            person_scores(result.people[row].joints, result.people[row].contact, fact, touched)
        )
        mean = person_scores(np.mean(averaged, axis=0), result.people[row].contact, fact, touched)
        single.append({**mean, "F1": float(np.mean(f1))})
    cameras = [
        camera_scores(
            photo.camera, world.camera.rotation, world.camera.position, worlds[photo.index].camera
        )
        for photo in found.photos
    ]
    around = mean_of(row for row in cameras if row)
    return {"joint": {**mean_of(joint), **around}, "average of single results": mean_of(single)}


def person_scores(joints: Any, contact: Any, fact: Any, touched: Any) -> dict[str, float]:
    """Return the errors of one person, mm, and the F1 of contact."""
    joints = np.asarray(joints, np.float64)[None, :22]
    factor = float(np.exp(np.median(np.log(fact[:, 2] / joints[0, :, 2]))))
    f1 = precision_recall_f1(contact_counts(np.asarray(contact)[None], np.asarray(touched)[None]))[
        2
    ]
    return {
        "PA": float(pa_mpjpe_mm(joints, fact[None])[0]),
        "MPJPE": float(mpjpe_mm(joints, fact[None])[0]),
        "after one factor": float(mpjpe_mm(factor * joints, fact[None])[0]),
        "F1": float(f1[0]),
    }


def camera_scores(camera: Any, rotation: Any, position: Any, true: Any) -> dict[str, float]:
    """Return the errors of a camera's rotation and distance relative to the reference; empty for
    the reference.
    """
    away = np.linalg.norm(true.position - position)
    if away < 1e-9:
        return {}
    turn = true.rotation @ rotation.T
    angle = np.degrees(np.arccos(np.clip((np.trace(camera.rotation @ turn.T) - 1) / 2, -1, 1)))
    return {
        "camera deg": float(angle),
        "distance %": float(100 * abs(np.linalg.norm(camera.centre) / away - 1)),
    }


# ---- results
# --------------------------------------------------------------------------------------------------


def mean_of(rows: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of each number."""
    taken = list(rows)
    return {
        key: float(np.nanmean([row[key] for row in taken])) for key in (taken[0] if taken else {})
    }


def print_table(rows: Mapping[str, Sequence[Mapping[str, float]]]) -> None:
    """Print a Markdown table of means over worlds or moments."""
    columns = list(dict.fromkeys(key for scores in rows.values() for row in scores for key in row))
    table = [["", "n", *columns]]
    for name, scores in rows.items():
        values = [[row[column] for row in scores if column in row] for column in columns]
        table.append(
            [name, str(len(scores)), *(f"{np.mean(own):.3g}" if own else "-" for own in values)]
        )
    print(markdown_table(table))


if __name__ == "__main__":
    main()
