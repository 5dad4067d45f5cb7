"""Measure the errors of single photos that ``physic scene`` expects, on worlds with several
cameras.

    python -m benchmarks.scene_errors OUT --names group walk --seeds 3 4

Writes ``plugins/physic-scene/physic_scene/measured_errors.json``. Results of single photos are kept
in OUT, as those of ``benchmarks.scene``. People have noise of version 4 and other bodies.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression
from scipy.spatial.transform import Rotation

from benchmarks.scene import NAMES, SIZE, world_seed
from physic_bench.kept import kept
from physic_bench.worlds.world_evidence import noisy_config
from physic_core.metrics import match_by_masks

TARGET = Path(__file__).parents[1] / "plugins/physic-scene/physic_scene/measured_errors.json"
VIEWS = 4
BINS = (0.0, 0.2, 0.4, 0.6, 0.84, 1.01)  # of keypoint confidence


@dataclass(frozen=True)
class WorldView:
    """One photo of a world: its people, their numbers in the world, and the truth."""

    people: Any
    number: list[int]
    world: Any
    points: Any  # (N, J, 3) true landmarks of the world's people, room frame


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--names", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4])
    given = parser.parse_args()
    moments = list(_moments(given.out, given.names, given.seeds))
    content = {
        "source": f"benchmarks/scene_errors.py on worlds {', '.join(given.names)} of seeds "
        f"{', '.join(map(str, given.seeds))}, {VIEWS} views, noise 4, other bodies",
        **_errors(moments),
    }
    TARGET.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
    print(TARGET.read_text("utf-8"))


def _moments(out: Path, names: Sequence[str], seeds: Sequence[int]) -> Iterator[list[WorldView]]:
    import torch

    from physic_core.body import load_body
    from physic_scene import ScenePipeline
    from physic_scene.photos import ScenePhoto
    from physic_testing.worlds import build_world, view_names

    out.mkdir(parents=True, exist_ok=True)
    model = load_body("embedded").to(dtype=torch.float64)
    with ScenePipeline(noisy_config()) as scene:
        for name, given in itertools.product(names, seeds):
            seed = world_seed(name, given)
            views: list[WorldView] = []
            worlds = [build_world(view, seed, SIZE) for view in view_names(f"{name}+other", VIEWS)]
            points = _true_points(worlds)
            for world in worlds:
                image = world.image
                result = kept(
                    out / f"{world.name}-{seed}.pkl", lambda image=image: scene.alone(image)
                )
                photo = ScenePhoto.of(len(views), world.name, result, model)
                people = photo.people
                masks = np.stack([result.people[row].mask for row in photo.rows])
                match = match_by_masks(masks, world.masks, min_iou=0.3)
                number = dict(zip(match.predicted.tolist(), match.truth.tolist(), strict=True))
                views.append(
                    WorldView(
                        people, [number.get(i, -1) for i in range(len(people))], world, points
                    )
                )
            yield views


def _true_points(worlds: Sequence[Any]) -> Any:
    """Return the true landmarks (N, J, 3), room frame, from their pixels in all views."""
    left = 0.0
    right = 0.0
    for world in worlds:
        K = world.intrinsics.matrix
        uv = world.keypoints["blazepose33"]
        rays = (
            np.concatenate([uv, np.ones((*uv.shape[:2], 1))], axis=-1)
            @ np.linalg.inv(K).T
            @ world.camera.rotation
        )
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        across = np.eye(3) - rays[..., None] * rays[..., None, :]
        left = left + across
        right = right + across @ world.camera.position
    return np.linalg.solve(left, np.asarray(right)[..., None])[..., 0]


# ---- errors of cameras and bodies
# ------------------------------------------------------------------------------------


def _errors(moments: Sequence[list[WorldView]]) -> dict[str, Any]:
    from physic_scene.measured import keypoint_class, keypoint_clusters
    from physic_scene.rigid import fit_rotation

    keypoints = []
    confidence = []
    landmarks = []
    turns = []
    bones = []
    floors = []
    focals = []
    for views in moments:
        own_focals = []
        for view in views:
            world = view.world
            people = view.people
            names = people.skeleton.names
            own_focals.append(np.log(people.K[0, 0] / world.intrinsics.fx))
            if np.isfinite(people.up).all():
                floors.append(_turn_deg(people.up, np.asarray(world.floor.normal)))
            for i, number in enumerate(view.number):
                if number < 0:
                    continue
                true = world.camera.to_camera(view.points[number])
                keypoints.append(
                    (people.points[i] - world.keypoints["blazepose33"][number]) / people.size_px[i]
                )
                confidence.append(people.confidence[i])
                a = people.landmarks[i] - people.landmarks[i].mean(0)
                b = true - true.mean(0)
                turn = fit_rotation(a, b, np.ones(len(a)))
                away = np.linalg.norm(b) / np.linalg.norm(a) * a @ turn.T - b
                ray = true.mean(0) / np.linalg.norm(true.mean(0))
                along = away @ ray
                across = np.linalg.norm(away - along[:, None] * ray, axis=1) / np.sqrt(2)
                landmarks.append(np.stack([along, across], axis=1))
                vector = np.degrees(Rotation.from_matrix(turn).as_rotvec())
                turns.append(
                    [vector @ ray, np.linalg.norm(vector - (vector @ ray) * ray) / np.sqrt(2)]
                )
                bones.append(_bone_errors(people.landmarks[i], true, names))
        focals.append(own_focals)
    kinds = np.array([keypoint_class(name) for name in names])
    cluster = keypoint_clusters(names)
    errors = np.array(keypoints)
    sure = np.array(confidence)
    bodies = np.array(landmarks)
    centres = []
    sigmas = []
    counts = []
    for low, high in itertools.pairwise(BINS):
        inside = (sure > low) & (sure < high)
        if inside.sum() >= 50:
            centres.append(float(sure[inside].mean()))
            sigmas.append(_robust(errors[inside]))
            counts.append(int(inside.sum()))
    unit = np.interp(sure, centres, sigmas)[..., None]
    of_class = {
        kind: [_robust(bodies[:, kinds == kind, k]) for k in (0, 1)] for kind in sorted(set(kinds))
    }
    shared = np.array(focals)
    return {
        "confidence": _rounded(centres),
        "keypoint": _rounded(isotonic_regression(sigmas, weights=counts, increasing=False).x),
        "keypoint_correlation": _correlation(
            np.where(sure[..., None] > 0, errors / unit, np.nan), cluster
        ),
        "landmark_m": {kind: _rounded(values) for kind, values in of_class.items()},
        "turn_deg": _rounded(np.sqrt(np.mean(np.square(turns), axis=0))),
        "bone": round(_robust(np.array(bones)), 4),
        "floor_deg": round(float(np.sqrt(np.mean(np.square(floors)) / 2)), 2),
        # An estimator's mean error on all photos is unknown to a user: it is a part that photos
        # share.
        "focal": _rounded(
            [np.sqrt((shared.mean(1) ** 2).mean()), shared.std(axis=1, ddof=1).mean()]
        ),
    }


def _bone_errors(landmarks: Any, true: Any, names: Sequence[str]) -> Any:
    """Return the errors of the logarithms of bone lengths, up to their mean."""
    from physic_scene.bundle import bones_of

    a, b = bones_of(names).T
    ratio = np.log(
        np.linalg.norm(landmarks[b] - landmarks[a], axis=1)
        / np.linalg.norm(true[b] - true[a], axis=1)
    )
    return ratio - ratio.mean()


def _turn_deg(one: Any, two: Any) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ two, -1, 1))))


def _robust(values: Any) -> float:
    """Return the standard deviation of normal errors with the same median size."""
    return float(np.median(np.abs(values)) / 0.6745)


def _correlation(scaled: Any, cluster: Any) -> float:
    """Return the mean correlation of errors (n, J, d), in units of their sizes, within clusters;
    large ones are cut.
    """
    cut = np.clip(scaled, -2.5, 2.5)
    cut = cut / np.sqrt(np.nanmean(cut**2))
    found = []
    for number in np.unique(cluster):
        pairs = itertools.combinations(np.flatnonzero(cluster == number), 2)
        found.append([np.nanmean(cut[:, a] * cut[:, b]) for a, b in pairs])
    return round(float(np.mean([np.mean(products) for products in found if products])), 3)


def _rounded(values: Any) -> list[float]:
    return [round(float(value), 4) for value in values]


if __name__ == "__main__":
    main()
