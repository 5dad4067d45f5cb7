"""Measure the errors of single photos that ``physic scene`` expects, on worlds with several cameras.

    python -m benchmarks.scene_errors OUT --names group walk --seeds 3 4

Writes ``plugins/physic-scene/physic_scene/measured_errors.json``. Results of single photos are kept in OUT, as those of
``benchmarks.scene``. People have noise of version 4 and other bodies. Photos of one moment differ in exposure and white
balance by EXPOSURE and WHITE_BALANCE, which are assumed: the worlds' own cameras differ in exposure only.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression, minimize
from scipy.spatial.transform import Rotation

from benchmarks.scene import NAMES, SIZE, kept, mock_config, world_seed
from physic_core.metrics import match_by_masks

TARGET = Path(__file__).parents[1] / "plugins/physic-scene/physic_scene/measured_errors.json"
VIEWS = 4
EXPOSURE = 0.25  # standard deviation of a photo's exposure, stops
WHITE_BALANCE = 0.08  # of the logarithm of the gains of red and of blue
KNOTS = 9  # of a cue's table
BINS = (0.0, 0.2, 0.4, 0.6, 0.84, 1.01)  # of keypoint confidence


@dataclass(frozen=True)
class View:
    """One photo of a world: its people, their numbers in the world, and the truth."""

    people: Any
    number: list[int]
    world: Any
    points: Any  # (N, J, 3) true landmarks of the world's people, room frame


def main() -> None:
    """Measure and write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--names", nargs="+", choices=NAMES, default=NAMES)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4])
    given = parser.parse_args()
    moments = list(_moments(given.out, given.names, given.seeds))
    content = {
        "source": f"benchmarks/scene_errors.py on worlds {', '.join(given.names)} of seeds "
        f"{', '.join(map(str, given.seeds))}, {VIEWS} views, noise 4, other bodies",
        **_errors(moments),
        "cues": _cues(moments),
    }
    TARGET.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
    print(TARGET.read_text("utf-8"))


def _moments(out: Path, names: Sequence[str], seeds: Sequence[int]) -> Iterator[list[View]]:
    import torch

    from physic_core.body import load_body
    from physic_scene import Scene
    from physic_scene.observations import observe
    from physic_testing.worlds import build_world, view_names

    out.mkdir(parents=True, exist_ok=True)
    model = load_body("embedded").to(dtype=torch.float64)
    with Scene(mock_config()) as scene:
        for name, given in itertools.product(names, seeds):
            seed = world_seed(name, given)
            views: list[View] = []
            worlds = [build_world(view, seed, SIZE) for view in view_names(f"{name}+other", VIEWS)]
            points = _true_points(worlds)
            for world in worlds:
                image = world.image
                result = kept(out / f"{world.name}-{seed}.pkl", lambda image=image: scene.alone(image))
                rng = np.random.default_rng([seed, len(views)])
                people = observe(replace(result, image=_other_light(result.image, rng)), model)
                masks = np.stack([result.people[row].mask for row in people.rows])
                match = match_by_masks(masks, world.masks, min_iou=0.3)
                number = dict(zip(match.predicted.tolist(), match.truth.tolist(), strict=True))
                views.append(View(people, [number.get(i, -1) for i in range(len(people))], world, points))
            yield views


def _other_light(image: Any, rng: np.random.Generator) -> Any:
    """Return a photo (H, W, 3) uint8 of another exposure and white balance."""
    gain = 2 ** rng.normal(0, EXPOSURE) * np.exp(rng.normal(0, WHITE_BALANCE, 3) * [1, 0, 1])
    return np.clip(np.round(255 * np.clip((np.asarray(image) / 255) ** 2.2 * gain, 0, 1) ** (1 / 2.2)), 0, 255).astype(
        np.uint8
    )


def _true_points(worlds: Sequence[Any]) -> Any:
    """Return the true landmarks (N, J, 3), room frame, from their pixels in all views."""
    left, right = 0.0, 0.0
    for world in worlds:
        K, uv = world.intrinsics.matrix, world.keypoints["blazepose33"]
        rays = np.concatenate([uv, np.ones((*uv.shape[:2], 1))], axis=-1) @ np.linalg.inv(K).T @ world.camera.rotation
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        across = np.eye(3) - rays[..., None] * rays[..., None, :]
        left, right = left + across, right + across @ world.camera.position
    return np.linalg.solve(left, np.asarray(right)[..., None])[..., 0]


# ---- errors of cameras and bodies ------------------------------------------------------------------------------------


def _errors(moments: Sequence[list[View]]) -> dict[str, Any]:
    from physic_scene.measured import keypoint_class, keypoint_clusters
    from physic_scene.rigid import fit_rotation

    keypoints, confidence, landmarks, turns, bones, floors, focals = [], [], [], [], [], [], []
    for views in moments:
        own_focals = []
        for view in views:
            world, people = view.world, view.people
            names = people.skeleton.names
            own_focals.append(np.log(people.K[0, 0] / world.intrinsics.fx))
            if np.isfinite(people.up).all():
                floors.append(_turn_deg(people.up, np.asarray(world.floor.normal)))
            for i, number in enumerate(view.number):
                if number < 0:
                    continue
                true = world.camera.to_camera(view.points[number])
                keypoints.append((people.points[i] - world.keypoints["blazepose33"][number]) / people.size_px[i])
                confidence.append(people.confidence[i])
                a, b = people.landmarks[i] - people.landmarks[i].mean(0), true - true.mean(0)
                turn = fit_rotation(a, b, np.ones(len(a)))
                away = np.linalg.norm(b) / np.linalg.norm(a) * a @ turn.T - b
                ray = true.mean(0) / np.linalg.norm(true.mean(0))
                along = away @ ray
                across = np.linalg.norm(away - along[:, None] * ray, axis=1) / np.sqrt(2)
                landmarks.append(np.stack([along, across], axis=1))
                vector = np.degrees(Rotation.from_matrix(turn).as_rotvec())
                turns.append([vector @ ray, np.linalg.norm(vector - (vector @ ray) * ray) / np.sqrt(2)])
                bones.append(_bone_errors(people.landmarks[i], true, names))
        focals.append(own_focals)
    kinds, cluster = np.array([keypoint_class(name) for name in names]), keypoint_clusters(names)
    errors, sure, bodies = np.array(keypoints), np.array(confidence), np.array(landmarks)
    centres, sigmas, counts = [], [], []
    for low, high in itertools.pairwise(BINS):
        inside = (sure > low) & (sure < high)
        if inside.sum() >= 50:
            centres.append(float(sure[inside].mean()))
            sigmas.append(_robust(errors[inside]))
            counts.append(int(inside.sum()))
    unit = np.interp(sure, centres, sigmas)[..., None]
    of_class = {kind: [_robust(bodies[:, kinds == kind, k]) for k in (0, 1)] for kind in sorted(set(kinds))}
    shared = np.array(focals)
    return {
        "keypoint": {
            "confidence": _rounded(centres),
            "sigma": _rounded(isotonic_regression(sigmas, weights=counts, increasing=False).x),
            "correlation": _correlation(np.where(sure[..., None] > 0, errors / unit, np.nan), cluster),
        },
        "landmark_m": {kind: _rounded(values) for kind, values in of_class.items()},
        "turn_deg": _rounded(np.sqrt(np.mean(np.square(turns), axis=0))),
        "bone": round(_robust(np.array(bones)), 4),
        "floor_deg": round(float(np.sqrt(np.mean(np.square(floors)) / 2)), 2),
        # An estimator's mean error on all photos is unknown to a user: it is a part that photos share.
        "focal": _rounded([np.sqrt((shared.mean(1) ** 2).mean()), shared.std(axis=1, ddof=1).mean()]),
    }


def _bone_errors(landmarks: Any, true: Any, names: Sequence[str]) -> Any:
    """Return the errors of the logarithms of bone lengths, up to their mean."""
    from physic_scene.bundle import bones_of

    a, b = bones_of(names).T
    ratio = np.log(np.linalg.norm(landmarks[b] - landmarks[a], axis=1) / np.linalg.norm(true[b] - true[a], axis=1))
    return ratio - ratio.mean()


def _turn_deg(one: Any, two: Any) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ two, -1, 1))))


def _robust(values: Any) -> float:
    """Return the standard deviation of normal errors with the same median size."""
    return float(np.median(np.abs(values)) / 0.6745)


def _correlation(scaled: Any, cluster: Any) -> float:
    """Return the mean correlation of errors (n, J, d), in units of their sizes, within clusters; large ones are cut."""
    cut = np.clip(scaled, -2.5, 2.5)
    cut = cut / np.sqrt(np.nanmean(cut**2))
    found = []
    for number in np.unique(cluster):
        pairs = itertools.combinations(np.flatnonzero(cluster == number), 2)
        found.append([np.nanmean(cut[:, a] * cut[:, b]) for a, b in pairs])
    return round(float(np.mean([np.mean(products) for products in found if products])), 3)


def _rounded(values: Any) -> list[float]:
    return [round(float(value), 4) for value in values]


# ---- cues of matching ------------------------------------------------------------------------------------------------


def _cues(moments: Sequence[list[View]]) -> dict[str, dict[str, list[float]]]:
    """Return the table of each cue, from people of the same moment and of other moments.

    Cues of looks have causes in common: their LLRs have the weights of a logistic regression.
    """
    from physic_scene.matching import look_cues, place_cues, relative_motion

    looks: dict[str, list[Any]] = {"same": [], "near": [], "far": []}
    places: dict[str, list[Any]] = {"same": [], "near": []}
    for views in moments:
        for a, b in itertools.combinations(views, 2):
            cues, turns = look_cues(a.people, b.people)
            true = [
                (i, j, 0.0)
                for (i, p), (j, q) in itertools.product(enumerate(a.number), enumerate(b.number))
                if p == q >= 0
            ]
            for i, j in np.ndindex(turns.shape[:2]):
                kind = "same" if a.number[i] == b.number[j] >= 0 else "near"
                looks[kind].append([values[i, j] for values in cues.values()])
                # Places: under the motion of the other people.
                others = [pair for pair in true if pair[0] != i and pair[1] != j]
                if others:
                    motion = relative_motion(a.people, b.people, others)
                    found = place_cues(a.people, b.people, motion, turns)
                    places[kind].append([values[i, j] for values in found.values()])
    for one, two in itertools.combinations(moments, 2):
        values, _ = look_cues(one[0].people, two[1].people)
        looks["far"] += list(np.stack([value.reshape(-1) for value in values.values()], axis=1))
    own = {name: np.array(rows) for name, rows in looks.items()}
    tables = {name: _table(*(own[kind][:, k] for kind in ("same", "near", "far"))) for k, name in enumerate(cues)}
    weights = _weights([_llrs(own[kind], tables) for kind in ("same", "near", "far")])
    for table, weight in zip(tables.values(), weights, strict=True):
        table["llr"] = _rounded(weight * np.array(table["llr"]))
    near = [np.array(places[kind]) for kind in ("same", "near")]
    return tables | {name: _table(near[0][:, k], near[1][:, k], near[1][:, k]) for k, name in enumerate(found)}


def _llrs(values: Any, tables: dict[str, dict[str, list[float]]]) -> Any:
    """Return the LLRs (n, K) of cues (n, K); 0 where a cue is missing."""
    found = [np.interp(column, t["values"], t["llr"]) for column, t in zip(values.T, tables.values(), strict=True)]
    return np.nan_to_num(np.stack(found, axis=1))


def _weights(llrs: Sequence[Any]) -> Any:
    """Return the weights (K,) of LLRs by logistic regression; the kinds of different people count alike."""

    def loss(weights: Any) -> float:
        same, near, far = (np.logaddexp(0, s * rows @ weights).mean() for s, rows in zip((-1, 1, 1), llrs, strict=True))
        return float(same + (near + far) / 2 + 0.01 * np.square(weights - 1).sum())

    count = llrs[0].shape[1]
    return minimize(loss, np.ones(count), bounds=[(0.0, 1.0)] * count).x


def _table(same: Sequence[float], near: Sequence[float], far: Sequence[float]) -> dict[str, list[float]]:
    """Return the LLR at the knots of a cue: falling, and no surer than the number of pairs allows.

    Different people are half those of the same moment, and half those of other moments.
    """
    one, two, three = (np.array(x)[np.isfinite(x)] for x in (same, near, far))
    edges = np.unique(np.quantile(one, np.linspace(0, 1, KNOTS)))
    edges = np.concatenate([edges[:-1], [edges[-1], max(edges[-1] * 1.5, np.quantile(three, 0.5))], [np.inf]])
    edges[0] = 0.0

    def share(values: Any) -> Any:
        return (np.histogram(values, edges)[0] + 0.5) / (len(values) + 0.5 * (len(edges) - 1))

    ratio = np.log(share(one)) - np.log((share(two) + share(three)) / 2)
    falling = isotonic_regression(ratio, increasing=False).x
    middles = np.append((edges[:-2] + edges[1:-1]) / 2, edges[-2])
    return {"values": _rounded(middles), "llr": _rounded(falling)}


if __name__ == "__main__":
    main()
