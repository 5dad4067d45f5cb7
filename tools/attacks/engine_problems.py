"""Random problems for the engine, as valid backends could return them: a finite result, or a documented error.

``python tools/attacks/engine_problems.py --minutes 10`` runs seeds one after another and exits with 1 if one fails; the
traceback of a failure is written to ``--keep``. ``--case SEED`` runs one again.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
import warnings
from dataclasses import fields, replace
from itertools import count
from pathlib import Path

import numpy as np
import torch

from physic_core import engine_preset, engine_preset_names
from physic_core.body import load_body
from physic_core.body.parameters import parameters_from_rotations
from physic_core.body.rotations import rotvec_to_rotmat
from physic_core.engine.settings import EngineSettings, with_overrides
from physic_core.errors import PhysicError
from physic_core.files.strict_json import to_json
from physic_core.pipeline.checks import run_checks
from physic_core.pipeline.estimate import Estimates
from physic_core.pipeline.optimise import run_engine
from physic_core.pipeline.stage_runner import StageRunner
from physic_core.types import (
    SKELETONS,
    Bodies,
    BodyParameters,
    ContactProbability,
    DepthMap,
    Intrinsics,
    Keypoints,
    KnownSizes,
    People,
    Plane,
    Pointmap,
)

__all__ = ["check_engine", "few_steps", "random_estimates"]


def few_steps(preset: str) -> EngineSettings:
    """Return the settings of a preset with two steps of its optimiser."""
    return with_overrides(engine_preset(preset), {"joint": {"optimiser": {"steps": 2}}})


def random_estimates(seed: int) -> Estimates:
    """Return results of backends for a random photo with 0 to 30 people."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(32, 56, 2).tolist()
    camera = Intrinsics.from_focal(float(width * 10 ** rng.uniform(-0.7, 0.7)), int(width), int(height))
    unit = 10 ** rng.uniform(-3, 3)  # of the relative point map
    depth = _depth(rng, height, width)
    points = _points(rng, depth, camera) * unit
    valid = np.isfinite(points).all(-1) & (points[..., 2] > 0) & (rng.random(depth.shape) < rng.choice([1, 0.5, 0.01]))
    valid[height // 2, width // 2] = True
    points = np.where(valid[..., None], points, 1.0).astype(np.float32)
    masks = _masks(rng, height, width)
    people = len(masks)
    metric = depth * 10 ** rng.choice([0, 0, rng.uniform(-2, 2)])
    metric[rng.random(depth.shape) < rng.choice([0, 0.3, 0.99])] = np.nan
    metric[0, 0] = 2.0
    unknown = str(rng.choice(["scale", "scale_shift", "inverse_scale_shift"]))
    scene = Pointmap(points, valid, unknown, camera if rng.random() < 0.7 else None)  # type: ignore[arg-type]
    noise = rng.choice([0, 0.02, 1.0])
    original = replace(scene, points=(points * (1 + noise * rng.random((*depth.shape, 1)))).astype(np.float32))
    bodies, keypoints = _people(rng, people, camera)
    image = rng.integers(0, 255, (height, width, 3), np.uint8)
    missing = np.isnan(bodies.parameters.transl).any(1)
    boxes = [[0, 0, width, height]] * people
    model = load_body("embedded")
    return Estimates(
        image=image,
        intrinsics=camera,
        camera_given=bool(rng.random() < 0.3),
        people=People(
            masks,
            np.array(boxes, np.float32).reshape(people, 4),
            np.ones(people, np.float32),
            floor=rng.random(depth.shape) < rng.random() if rng.random() < 0.5 else None,
        ),
        keypoints=keypoints,
        hole=masks.any(0) if people else np.zeros(depth.shape, bool),
        inpainted=image,
        scene=scene,
        original=original,
        floor=Plane(_unit(rng), float(unit * rng.choice([0, 1.5, -1]))) if rng.random() < 0.5 else None,
        bodies=bodies,
        contact=ContactProbability(
            (rng.random((people, model.num_vertices)) * rng.choice([0, 1])).astype(np.float32), model.topology
        ),
        depth=DepthMap(
            metric.astype(np.float32),
            camera if rng.random() < 0.5 else None,
            rng.choice([None, 0.0, 0.1, 1e3]),  # type: ignore[arg-type]
        ),
        missing_results=tuple(("body_estimator",) if lost else () for lost in missing),
        known=KnownSizes(camera_height=float(rng.uniform(0.1, 5))) if rng.random() < 0.2 else KnownSizes(),
    )


def _depth(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """Return metres (H, W): a floor before a wall, a plane, a constant, noise or steps."""
    rows = np.linspace(-1, 1, height)[:, None] * np.ones(width)
    kind = rng.integers(5)
    if kind == 0:
        return np.minimum(np.where(rows > 0.05, 1.4 / np.maximum(rows, 0.05), np.inf), 6.0)
    if kind == 1:
        return 3 + rng.uniform(-1, 1) * rows
    if kind == 2:
        return np.full((height, width), 3.0)
    if kind == 3:
        return 10 ** rng.uniform(-1, 2, (height, width))
    return np.where(np.arange(width) % 7 < 3, 2.0, 200.0) * np.ones((height, 1))


def _points(rng: np.random.Generator, depth: np.ndarray, camera: Intrinsics) -> np.ndarray:
    height, width = depth.shape
    kind = rng.integers(8)
    if kind == 0:
        return np.ones((height, width, 3))  # all points equal
    v, u = np.mgrid[:height, :width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1)
    if kind == 1:
        rays[..., :2] = 0  # all points on one line
    return rays * depth[..., None]


def _masks(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """Return disjoint masks (N, H, W), each a box of at least one pixel."""
    masks: list[np.ndarray] = []
    free = np.ones((height, width), bool)
    for _ in range(rng.choice([0, 1, 1, 1, 2, 3, 30], p=[0.1, 0.2, 0.2, 0.2, 0.15, 0.1, 0.05])):
        x, y = rng.integers(0, width), rng.integers(0, height)
        side = rng.choice([1, 5, 20, 60])
        mask = np.zeros_like(free)
        mask[y : y + 2 * side, x : x + side] = True
        mask &= free
        if mask.any():
            masks.append(mask)
            free &= ~mask
    return np.array(masks).reshape(len(masks), height, width)


def _people(rng: np.random.Generator, people: int, camera: Intrinsics) -> tuple[Bodies, Keypoints]:
    model = load_body("embedded")
    spread = rng.choice([0.1, 1.0, 10.0])
    turns = rng.normal(0, spread, (people, 55, 3))
    betas = (
        torch.from_numpy(rng.normal(0, rng.choice([0.5, 3, 30]), (people, model.num_betas))).float().clamp(-100, 100)
    )
    at = np.array([0, 0, rng.choice([3, 3, 3, 0, -3, 0.1, 100, 1e4])])
    transl = torch.from_numpy(rng.normal(at, rng.choice([0, 0.5, 2]), (people, 3))).float().clamp(-1e4, 1e4)
    rotations = torch.from_numpy(rotvec_to_rotmat(turns)).float()
    skeleton = SKELETONS["coco23"]
    with torch.no_grad():
        posed = model(rotations, betas, transl, betas.new_zeros(people, model.num_expression))
        seen = model.landmarks(posed, skeleton).numpy()
    with np.errstate(all="ignore"):
        points = seen[..., :2] / seen[..., 2:] * camera.fx + [camera.cx, camera.cy]
    kind = rng.integers(4)
    if kind == 0:
        points = rng.uniform(0, camera.width, points.shape)
    elif kind == 1:
        points = np.full(points.shape, 10.0)  # all in one place
    points = np.clip(np.nan_to_num(points), -1e5, 1e5)
    confidence = rng.choice([0.0, 0.2, 0.9, 1.0], points.shape[:2]) if rng.random() < 0.7 else np.ones(points.shape[:2])
    if rng.random() < 0.2:
        confidence *= np.arange(len(skeleton)) == 3  # one point is seen
    parameters = parameters_from_rotations(rotations, betas, betas.new_zeros(people, model.num_expression), transl)
    lost = rng.random(people) < 0.1  # of a body estimator without valid numbers for this person
    blank = {f.name: np.where(lost[:, None], np.nan, getattr(parameters, f.name)) for f in fields(BodyParameters)}
    observed = rng.random((people, 55)) < 0.8 if rng.random() < 0.5 else None
    return (
        Bodies(BodyParameters(**blank), model.name, observed),
        Keypoints(points.astype(np.float32), confidence.astype(np.float32), skeleton.name),
    )


def _unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return (vector / np.linalg.norm(vector)).astype(np.float32)


def check_engine(estimates: Estimates, settings: EngineSettings) -> None:
    """Run the engine and the self-checks, and require a finite result or a PhysicError."""
    model = load_body("embedded")
    try:
        solution = run_engine(estimates, settings, model, StageRunner("cpu", 9))
    except PhysicError:
        return
    checks = run_checks(estimates, solution, settings)
    given = np.isfinite(estimates.bodies.parameters.transl).all(1)
    for i, has_body in enumerate(given):
        assert np.isfinite(solution.vertices[i]).all() == has_body, f"vertices of person {i}"
        assert np.isfinite(solution.joints[i]).all() == has_body, f"joints of person {i}"
        assert not np.isnan(solution.distance[i]).any(), f"distance of person {i}"
        assert has_body or not solution.contact[i].any(), f"contact of person {i}"
    scene = solution.scene
    assert np.isfinite(scene.points[scene.valid]).all(), "scene"
    assert np.isfinite(scene.normals[scene.valid]).all(), "normals"
    assert np.isfinite(scene.scale), "scale"
    assert scene.scale > 0, "scale"
    assert scene.floor is None or np.isfinite([*scene.floor.normal, scene.floor.offset]).all(), "floor"
    assert np.isfinite(solution.intrinsics.matrix).all(), "camera"
    to_json({"people": [dict(p) for p in solution.people], "diagnostics": solution.diagnostics})
    assert checks


def main() -> int:
    """Run seeds until the time is over; return 1 if one failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seed", type=int, default=1_000_000)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"))
    parser.add_argument("--case", type=int, help="run this seed again")
    given = parser.parse_args()
    warnings.simplefilter("error")
    torch.set_num_threads(1)
    end, ran, failed = time.monotonic() + 60 * given.minutes, 0, 0
    for seed in [given.case] if given.case is not None else count(given.seed):
        if time.monotonic() > end:
            break
        ran += 1
        try:
            check_engine(random_estimates(seed), few_steps(engine_preset_names()[seed % len(engine_preset_names())]))
        except Exception:
            failed += 1
            path = given.keep / "engine" / f"{seed}.txt"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"python tools/attacks/engine_problems.py --case {seed}\n{traceback.format_exc()}")
            print(f"seed {seed} failed: {path}", flush=True)
    print(f"engine: {ran} problems, {failed} failed", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
