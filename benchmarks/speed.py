"""Speed of stage 3 of the engine, as ratios: against passes of the body model, and by the number of people.

    python -m benchmarks.speed [--repeats 5] [--preset default] [--size 640x480] [--people 1,2,4,8] [--seed 0]

Seconds depend on the machine and its load. The variants are therefore run in turns, and a ratio is the median of the
rounds' ratios. The problems are synthetic: people stand in a room, four per row, and the evidence is the truth with
noise of a realistic size, so that the optimisation takes as long as on a photo.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from physic_core import engine_preset
from physic_core.adapters.threads import limited_threads
from physic_core.body import load_body
from physic_core.body.joints import JOINT_INDEX
from physic_core.body.model import BodyModel
from physic_core.engine.joint.problem import JointProblem
from physic_core.engine.joint.solve import optimize
from physic_core.geometry.camera import pixel_grid, project, unproject
from physic_core.geometry.raster import rasterize
from physic_core.geometry.rotations import rotvec_to_rotmat
from physic_testing.worlds.skeletons import BLAZEPOSE

PASSES = 100

FLOOR_Y, WALL_Z = 1.4, 7.5  # metres; the camera looks level
IN_ROW, SPACING_M, FIRST_ROW_M, ROW_DEPTH_M = 4, 0.9, 3.6, 1.5
POSE_NOISE, PLACE_NOISE_M = 0.08, (0.02, 0.02, 0.12)  # radians
PIXEL_NOISE, DEPTH_NOISE = 0.004, 0.02  # of the image's height; of a smooth warp of the depth


def main() -> None:
    """Measure and print both tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.speed", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=5, help="rounds; medians are taken over them")
    parser.add_argument("--preset", default="default", help="of the engine")
    parser.add_argument("--size", default="640x480", help="of the photos, px")
    parser.add_argument("--people", default="1,2,4,8", help="numbers of people, up to 8")
    parser.add_argument("--seed", type=int, default=0, help="of the problems")
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    settings, model = engine_preset(given.preset).joint, load_body("embedded")
    exact = model.to(dtype=torch.float64)  # as in a run
    one = joint_problem(model, 1, (width, height), given.seed)
    inputs = [tensor.clone().requires_grad_() for tensor in (one.rotations0, one.betas0, one.transl0)]

    def passes() -> str:
        for _ in range(PASSES):
            torch.autograd.grad(model(*inputs).vertices.sum(), inputs)
        return ""

    def solve(problem: JointProblem) -> str:
        return f"{optimize(replace(problem, model=exact).to_model_dtype(), settings).evaluations} evaluations"

    by_people = {
        f"people: {count}": partial(solve, joint_problem(model, int(count), (width, height), given.seed))
        for count in given.people.split(",")
    }
    print(f"{platform.machine()}, {os.cpu_count()} cores, torch {torch.__version__}, preset {given.preset!r}")
    with limited_threads():  # as the pipeline does
        print(f"\nStage 3 against {PASSES} forward and backward passes of the body model in float32, one person")
        print(in_turns({f"{PASSES} passes": passes, "stage 3": partial(solve, one)}, given.repeats))
        print("\nStage 3 by people in the photo")
        print(in_turns(by_people, given.repeats))


def in_turns(runs: Mapping[str, Callable[[], str]], repeats: int) -> str:
    """Run functions in turns, after a round that warms up; return rows of median seconds and ratios to the first."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    notes = {}
    for turn in range(repeats + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            notes[name] = run()
            if turn:
                times[name].append(time.perf_counter() - start)
    first = next(iter(times.values()))
    ratios = {name: statistics.median(s / b for s, b in zip(own, first, strict=True)) for name, own in times.items()}
    return "\n".join(
        f"  {name:12}{statistics.median(own):8.3f} s{ratios[name]:8.2f} x  {notes[name]}" for name, own in times.items()
    )


def joint_problem(model: BodyModel, people: int, size: tuple[int, int], seed: int) -> JointProblem:
    """Build a problem of stage 3: people in a room, initialised near the truth.

    Args:
        model: embedded or SMPL-X body model, on the CPU.
        people: 1 to 8, so that all are in the image.
        size: width and height, px.
        seed: seed of shapes, noise and small pose differences.
    """
    width, height = size
    g = torch.Generator().manual_seed(seed)
    focal = 0.9 * width
    K = torch.tensor([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    rotations, betas, transl = _people(model, people, g)
    posed = model(rotations, betas, transl)
    scene, normals = _room(K, height, width)
    masks, depth = _masks_and_depth(posed.vertices, model, K, height, width, scene)
    keypoints = project(model.landmarks(posed, BLAZEPOSE), K)
    noise = torch.randn(people, 55, 3, generator=g)
    v, u = torch.meshgrid(torch.linspace(0, math.pi, height), torch.linspace(0, math.pi, width), indexing="ij")
    warp = 1 + DEPTH_NOISE * torch.sin(u + v)
    soles = torch.cat([model.contact_sets["left_sole"], model.contact_sets["right_sole"]])
    probability = torch.zeros(people, model.num_vertices)
    probability[:, soles] = 0.9
    return JointProblem(
        model=model,
        rotations0=rotations @ rotvec_to_rotmat(POSE_NOISE * noise),
        betas0=betas + 0.3 * torch.randn(betas.shape, generator=g),
        expression0=torch.zeros(people, model.num_expression),
        transl0=transl + torch.tensor(PLACE_NOISE_M) * torch.randn(people, 3, generator=g),
        keypoints=keypoints + PIXEL_NOISE * height * torch.randn(keypoints.shape, generator=g),
        keypoint_confidence=torch.ones(keypoints.shape[:2]),
        skeleton=BLAZEPOSE,
        K=K,
        masks=masks,
        scene_points=(scene * warp[..., None]).reshape(-1, 3),
        scene_normals=normals.reshape(-1, 3),
        contact_probability=probability,
        observed=torch.ones(people, 55, dtype=torch.bool),
        scene_depth=scene[..., 2] * warp,
        floor_normal=torch.tensor([0.0, -1.0, 0.0]),
        floor_offset=FLOOR_Y * 1.03,
        human_depth=depth * warp,
    )


def _people(model: BodyModel, people: int, g: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """Return rotations, betas and translations of people who stand, face the camera and lower their arms."""
    turns = 0.05 * torch.randn(people, 55, 3, generator=g)
    turns[:, JOINT_INDEX["left_shoulder"], 2] -= 1.2
    turns[:, JOINT_INDEX["right_shoulder"], 2] += 1.2
    rotations = rotvec_to_rotmat(turns)
    rotations[:, 0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    betas = 0.7 * torch.randn(people, model.num_betas, generator=g)
    transl = torch.zeros(people, 3)
    for i in range(people):
        row, column = divmod(i, IN_ROW)
        in_row = min(IN_ROW, people - row * IN_ROW)
        transl[i, 0] = (column - (in_row - 1) / 2) * SPACING_M + 0.3 * row
        transl[i, 2] = FIRST_ROW_M + row * ROW_DEPTH_M
    transl[:, 1] = FLOOR_Y - model(rotations, betas, transl).vertices[..., 1].amax(1)
    return rotations, betas, transl


def _room(K: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return points (H, W, 3) and normals of floor and wall as seen without people."""
    ray = unproject(pixel_grid(height, width, K), torch.ones(height, width), K)
    floor = torch.where(ray[..., 1] > 1e-6, FLOOR_Y / ray[..., 1].clamp(min=1e-6), torch.inf)
    is_floor = (floor < WALL_Z)[..., None]
    normals = torch.where(is_floor, torch.tensor([0.0, -1.0, 0.0]), torch.tensor([0.0, 0.0, -1.0]))
    return ray * floor.clamp(max=WALL_Z)[..., None], normals


def _masks_and_depth(
    vertices: Tensor, model: BodyModel, K: Tensor, height: int, width: int, scene: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the visible masks (B, H, W) of the people and the depth (H, W) of the photo."""
    faces = rasterize(project(vertices, K), vertices[..., 2], model.faces, height, width)
    people = torch.arange(len(vertices))[:, None, None]
    z = vertices[..., 2][people[..., None], model.faces[faces.clamp(min=0)]].mean(-1)
    nearest, owner = torch.where(faces >= 0, z, torch.inf).min(0)
    front = nearest < scene[..., 2]
    return (owner == people) & front, torch.where(front, nearest, scene[..., 2])


if __name__ == "__main__":
    main()
