"""How much a reconstruction depends on the kernels that OpenBLAS, ATen, MKL and numpy choose for the CPU.

    python -m benchmarks.kernels [--worlds 20] [--jobs 1]                 worlds, preset "mock"
    python -m benchmarks.kernels photos/ more.jpg --preset embedded       photos, or folders of them

Runs everything under each kernel set in a process of its own, without the cache, and compares with the first set. Ends
with 1 where vertices, floors or contact differ by more than the limits, or a check holds under one set and not under
another, and with 2 where two sets compute bit for bit the same, so that their comparison would show nothing. Kernels
that the CPU does not have are skipped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.jumps import jump
from physic_core import Reconstruction

SETS: dict[str, dict[str, str]] = {
    "Haswell": {
        "OPENBLAS_CORETYPE": "Haswell",
        "ATEN_CPU_CAPABILITY": "avx2",
        "MKL_CBWR": "AVX2",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
    },
    "Nehalem": {
        "OPENBLAS_CORETYPE": "Nehalem",
        "ATEN_CPU_CAPABILITY": "default",
        "MKL_CBWR": "COMPATIBLE",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
    },
    "SkylakeX": {"OPENBLAS_CORETYPE": "SkylakeX", "ATEN_CPU_CAPABILITY": "avx512"},
}
NEEDS = {"Haswell": ("X86_V3", "AVX2"), "SkylakeX": ("X86_V4", "AVX512_SKX")}
VERTEX_MM, FLOOR_DEG, LABELS = 5.0, 0.5, 1.0
PHOTOS = (".jpg", ".jpeg", ".png")
PROGRAM = (sys.executable, "-m", "benchmarks.kernels")


def main() -> int:
    """Run, compare, print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.kernels", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("photos", nargs="*", type=Path, help="photos or folders of photos; worlds where none is given")
    parser.add_argument("--preset", help="preset or config file; embedded for photos, mock for worlds")
    parser.add_argument("--worlds", type=int, default=20, help="how many worlds")
    parser.add_argument("--seed", type=int, default=0, help="of the worlds")
    parser.add_argument("--size", default="320x240", help="of the worlds' photos")
    parser.add_argument("--sets", default=",".join(SETS), help="kernel sets")
    parser.add_argument("--jobs", type=int, default=1, help="sets at once")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--probe", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.probe:
        print(arithmetic_digest())
        return 0
    if given.child:
        return answer_all(given.child)
    names = [name for name in given.sets.split(",") if runs_here(name)]
    if len(names) < 2:
        print(f"This CPU runs only {', '.join(names) or 'none'} of the kernel sets {given.sets}: nothing to compare.")
        return 0
    if alike := same_arithmetic({name: probe(name) for name in names}):
        print(f"The kernel sets {' and '.join(alike)} compute bit for bit the same here: leave one out of --sets.")
        return 2
    items = photos_of(given.photos) if given.photos else worlds_of(given.worlds, given.seed)
    task = {
        "items": items,
        "preset": given.preset or ("embedded" if given.photos else "mock"),
        "size": [int(side) for side in given.size.split("x")],
    }
    with ThreadPoolExecutor(given.jobs) as pool, tempfile.TemporaryDirectory() as folder:
        answers = list(pool.map(lambda name: run_set(name, task, Path(folder, name)), names))
    return report([str(item) for item in items], dict(zip(names, answers, strict=True)))


def runs_here(name: str) -> bool:
    """Whether the CPU has the kernels of a set."""
    known = np.show_config(mode="dicts")["SIMD Extensions"]
    found = [*known["baseline"], *known["found"]]
    if platform.machine() not in ("x86_64", "AMD64"):
        return False
    return name not in NEEDS or any(feature in found for feature in NEEDS[name])


def probe(name: str) -> str:
    """The digest of what a process computes under a kernel set."""
    command = [*PROGRAM, "--probe"]
    return subprocess.run(command, env=os.environ | SETS[name], check=True, capture_output=True, text=True).stdout


def arithmetic_digest() -> str:
    """SHA-256 of matrix products, a solution and elementary functions of numpy and torch."""
    import torch

    a = np.random.default_rng(0).standard_normal((257, 257))
    t = torch.from_numpy(a)
    made = [a @ a, np.linalg.solve(a, a[0]), (t @ t).numpy(), t.float().exp().mean(0).numpy(), t.svd().S.numpy()]
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in made)).hexdigest()


def same_arithmetic(digests: dict[str, str]) -> tuple[str, ...]:
    """The first kernel sets of one digest, or ()."""
    for digest in digests.values():
        alike = tuple(name for name, other in digests.items() if other == digest)
        if len(alike) > 1:
            return alike
    return ()


def photos_of(paths: list[Path]) -> list[str]:
    """Photos, those of folders by name."""
    found = []
    for path in paths:
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in PHOTOS) if path.is_dir() else [path]
        found += [str(photo.resolve()) for photo in inside]
    return found


def worlds_of(count: int, seed: int) -> list[str]:
    """Names and seeds as one word each."""
    from physic_testing.worlds import benchmark_worlds

    return [f"{name}:{own}" for name, own in benchmark_worlds(count, seed)]


def run_set(name: str, task: dict[str, Any], folder: Path) -> list[Reconstruction | str]:
    """Results of all items under one kernel set, or the error instead of one."""
    folder.mkdir()
    (folder / "task.json").write_text(json.dumps(task))
    subprocess.run([*PROGRAM, "--child", str(folder)], env=os.environ | SETS[name], check=True)
    return [
        (folder / f"{i}.txt").read_text() if (folder / f"{i}.txt").exists() else Reconstruction.load(folder / f"{i}")
        for i in range(len(task["items"]))
    ]


def answer_all(folder: Path) -> int:
    """In the process of one kernel set: reconstruct everything."""
    from physic_core.configuration.layers import is_path
    from physic_core.configuration.model import load_config
    from physic_core.errors import PhysicError
    from physic_core.pipeline.run import reconstruct
    from physic_testing.worlds import WORLDS, build_world

    task = json.loads((folder / "task.json").read_text())
    chosen = {"file" if is_path(task["preset"]) else "preset": task["preset"]}
    config = load_config(**chosen, overrides=["run.cache=false"])
    for i, item in enumerate(task["items"]):
        name, _, seed = item.rpartition(":")
        error = ""
        try:
            photo = build_world(name, int(seed), tuple(task["size"])).image if name in WORLDS else item
            reconstruct(photo, config).save(folder / f"{i}", "numbers")
        except PhysicError as cause:
            error = str(cause)
            (folder / f"{i}.txt").write_text(error)
        print(os.environ["OPENBLAS_CORETYPE"], item, error, file=sys.stderr, flush=True)
    return 0


@dataclass(frozen=True)
class Difference:
    """Of two answers about one photo; ``flips`` are checks that hold in one of them only."""

    vertex_mm: float
    floor_deg: float
    labels: float
    flips: tuple[str, ...]

    @property
    def large(self) -> bool:
        """Whether it is beyond the limits."""
        beyond = self.vertex_mm > VERTEX_MM or self.floor_deg > FLOOR_DEG or self.labels > LABELS
        return bool(beyond or self.flips)


def difference(one: Reconstruction | str, two: Reconstruction | str) -> Difference:
    """Compare two answers; what cannot be compared is infinitely far apart."""
    if isinstance(one, str) or isinstance(two, str):
        same = one == two
        return Difference(*([0.0] * 3 if same else [np.inf] * 3), () if same else ("a result / an error",))
    moved = jump(one, two)
    states = [{(c.name, c.person): c.state for c in result.checks} for result in (one, two)]
    flips = [
        f"{key[0]}{'' if key[1] is None else f' of {key[1]}'}: {' / '.join(state.get(key, 'none') for state in states)}"
        for key in sorted({*states[0], *states[1]}, key=str)
        if states[0].get(key) != states[1].get(key)
    ]
    floors = [None if r.scene.floor is None else r.scene.floor.normal for r in (one, two)]
    return Difference(moved.vertex_mm, floor_angle(*floors), moved.labels, tuple(flips))


def floor_angle(one: Any, two: Any) -> float:
    """Degrees between the normals of two floors."""
    if one is None or two is None:
        return 0.0 if one is two else np.inf
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two)))


def report(items: list[str], answers: dict[str, list[Reconstruction | str]]) -> int:
    """Print a row a photo, the worst of the sets against the first; 1 where one is beyond the limits."""
    first, *others = answers
    print(f"{'against ' + first:44}{'vertex mm':>10}{'floor deg':>10}{'labels %':>10}  checks that flip")
    large = 0
    for i, item in enumerate(items):
        for name in others:
            found = difference(answers[first][i], answers[name][i])
            large += found.large
            row = f"{Path(item).name[:32] + ' ' + name:44}{found.vertex_mm:10.3f}{found.floor_deg:10.3f}"
            print(f"{row}{found.labels:10.2f}  {'; '.join(found.flips)}{'  <-- beyond' if found.large else ''}")
    print(f"{large} of {len(items) * len(others)} beyond {VERTEX_MM:g} mm, {FLOOR_DEG} degrees, {LABELS:g} % of labels")
    return 1 if large else 0


if __name__ == "__main__":
    sys.exit(main())
