"""CPU time of ``physic evaluate prox`` on a set of PROX's size: 178 frames, and a scan of a million triangles.

    python benchmarks/evaluate.py write FOLDER      # the set, and results of one method
    python benchmarks/evaluate.py run FOLDER        # CPU seconds of all processes, and peak memory

Bodies and scan are synthetic; model files are made from the embedded body. The set is the one of the tests, larger.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import trimesh

FRAMES, SCAN_TRIANGLES = 178, 1_000_000
TESTS = Path(__file__).resolve().parents[1] / "plugins" / "physic-bench"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "run"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    write(given.folder) if given.what == "write" else run(given.folder, given.workers)


def write(folder: Path) -> None:
    """Write the set, the model files, and results 3 cm beside the truth whose contact is that within 3 cm."""
    sys.path.insert(0, str(TESTS))
    from physic_core.body.joints import JOINT_NAMES
    from tests.miniatures import write_models, write_plain
    from tests.prox_miniature import write_prox

    rng = np.random.default_rng(0)
    poses = {
        f"s001_frame_{i:05d}__00.00.{i:03d}": {
            "body_pose": 0.15 * rng.standard_normal(63),
            "transl": [rng.uniform(-1, 1), 0, rng.uniform(2.8, 4.5)],
        }
        for i in range(FRAMES)
    }
    made = write_prox(folder / "set", write_models(folder / "models"), poses=poses, scan=scan(), scale=4)
    for name, vertices in made.vertices.items():
        write_plain(
            folder / "theirs",
            name,
            vertices=(vertices[None] + [0.03, 0, 0]).astype(np.float32),
            joints=(made.joints[name][None, :22] + [0.03, 0, 0]).astype(np.float32),
            joint_names=np.array(JOINT_NAMES[:22]),
            contact=made.height[name][None] <= 0.03,
        )


def scan() -> trimesh.Trimesh:
    """A bumpy floor and some furniture, as a scanner gives them."""
    side = round((SCAN_TRIANGLES / 2) ** 0.5)
    x, y = np.meshgrid(np.linspace(-6, 6, side), np.linspace(-6, 6, side), indexing="ij")
    z = 0.004 * np.sin(9 * x) * np.cos(7 * y)
    for centre in ((-2, 2), (1.5, 3), (3, -1), (-3, -2)):
        z = np.maximum(z, np.where((np.abs(x - centre[0]) < 0.4) & (np.abs(y - centre[1]) < 0.6), 0.45, z))
    corner = np.arange(side * side).reshape(side, side)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return trimesh.Trimesh(np.stack([x, y, z], -1).reshape(-1, 3), faces, process=False)


def run(folder: Path, workers: int) -> None:
    """Evaluate once, without scores of earlier calls."""
    out = folder / f"out-{time.time_ns()}"
    command = [sys.executable, "-c", "from physic_core.cli import main; main()", "evaluate", "prox"]
    command += [str(folder / "set"), "-o", str(out), "--results", f"theirs=plain:{folder / 'theirs'}"]
    command += ["--smplx", str(folder / "models" / "smplx"), "--workers", str(workers)]
    start = time.perf_counter()
    subprocess.run(command, check=True)
    wall, used = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu, peak = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
    print(f"{FRAMES} frames: {cpu:.0f} CPU s, {wall:.0f} s with {workers} workers, largest process {peak:.0f} MiB")


if __name__ == "__main__":
    main()
