"""What the authors' published optimiser made of a problem, beside the engine's presets on the same inputs.

    python benchmarks/published_optimiser.py problem_one.npz

The file holds numbers only: the inputs of a synthetic problem (depth maps, masks, keypoints, contact probabilities, a
body of 2570 vertices at a wrong start), its truth, and each stage of the published code run on it. It is not part of
this project. Every preset runs all three stages of its own.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import torch

from physic_core.configuration.energies import check_engine_preset, engine_preset
from physic_core.errors import ConfigError
from physic_core.metrics import BODY_JOINTS, mpjpe_mm, mpvpe_mm, pa_mpjpe_mm
from physic_core.pipeline.optimise import run_engine
from physic_core.pipeline.stage_runner import StageRunner

sys.path.append(str(Path(__file__).parents[1] / "plugins" / "physic-paper" / "tests"))
from published import Published


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("problem", type=Path, help="problem_one.npz, the published optimiser's numbers")
    parser.add_argument("--presets", default="release,paper,default", help="comma-separated")
    given = parser.parse_args()
    names = given.presets.split(",")
    try:
        for name in names:
            check_engine_preset(name)
    except ConfigError as error:
        parser.error(str(error))
    if not given.problem.is_file():
        parser.error(f"there is no file {given.problem}: give the path of the published optimiser's numbers")
    torch.set_num_threads(1)
    published = Published(given.problem)
    rotations, betas, transl = published.given("truth")
    truth = published.body(rotations[0])(rotations, betas, transl)

    def show(name: str, joints: torch.Tensor, vertices: torch.Tensor, seconds: float | None = None) -> None:
        pair = joints.numpy()[:, BODY_JOINTS], truth.joints.numpy()[:, BODY_JOINTS]
        numbers = (mpjpe_mm(*pair), pa_mpjpe_mm(*pair), mpvpe_mm(vertices.numpy(), truth.vertices.numpy()))
        cells = " | ".join(f"{float(value.mean()):.1f}" for value in numbers)
        print(f"| {name} | {cells} |" + (f"  {seconds:.0f} s" if seconds is not None else ""), flush=True)

    print("| | MPJPE mm | PA-MPJPE mm | MPVPE mm |\n|---|---:|---:|---:|")
    rotations, betas, transl = published.given("init")
    start = published.body(rotations[0])(rotations, betas, transl)
    show("start", start.joints, start.vertices)
    end = published["one/out/s3_end/joints3d"][:, :55], published["one/out/s3_end/vertices"]
    show("published optimiser", *end)
    evidence, model = published.evidence(), published.body(rotations[0])
    for name in names:
        began = time.perf_counter()
        solution = run_engine(evidence, engine_preset(name), model, StageRunner("cpu", 4))
        seconds = time.perf_counter() - began
        show(f'preset "{name}"', torch.from_numpy(solution.joints), torch.from_numpy(solution.vertices), seconds)


if __name__ == "__main__":
    main()
