"""How much a reconstruction depends on the kernels that OpenBLAS, ATen, MKL and numpy choose for the CPU.

    python benchmarks/kernels.py [--worlds 20] [--jobs 1]                 worlds, preset "mock"
    python benchmarks/kernels.py photos/ more.jpg --preset embedded       photos, or folders of them

Runs everything under each kernel set in a process of its own, without the cache, and compares with the first set. Ends
with 1 where joints, floors or contact differ by more than the limits, or a check holds under one set and not under
another, and with 2 where two sets compute bit for bit the same, so that their comparison would show nothing. Kernels
that the CPU does not have are skipped.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import pickle
import platform
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

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
JOINT_MM, FLOOR_DEG, CONTACT_SHARE = 5.0, 0.5, 0.01
PHOTOS = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class KernelOutcome:
    """What is compared of one reconstruction; ``error`` instead of it."""

    joints: Any = None  # (N, 55, 3)
    floor: Any = None  # (4,) normal and offset, or None
    contact: Any = None  # (N, V)
    checks: Any = None  # {(name, person): ok}
    error: str = ""


def main() -> int:
    """Run, compare, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("photos", nargs="*", type=Path, help="photos or folders of photos; worlds where none is given")
    parser.add_argument("--preset", help="preset or config file; embedded for photos, mock for worlds")
    parser.add_argument("--worlds", type=int, default=20, help="how many worlds")
    parser.add_argument("--seed", type=int, default=0, help="of the worlds")
    parser.add_argument("--size", default="320x240", help="of the worlds' photos")
    parser.add_argument("--sets", default=",".join(SETS), help="kernel sets")
    parser.add_argument("--jobs", type=int, default=1, help="sets at once")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--probe", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.probe:
        print(arithmetic_digest())
        return 0
    if given.child:
        return answer_all(*given.child)
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
    with ThreadPoolExecutor(given.jobs) as pool:
        answers = dict(zip(names, pool.map(lambda name: run_set(name, task), names), strict=True))
    return report([str(item) for item in items], answers)


def runs_here(name: str) -> bool:
    """Whether the CPU has the kernels of a set."""
    known = np.show_config(mode="dicts")["SIMD Extensions"]
    found = [*known["baseline"], *known["found"]]
    if platform.machine() not in ("x86_64", "AMD64"):
        return False
    return name not in NEEDS or any(feature in found for feature in NEEDS[name])


def probe(name: str) -> str:
    """The digest of what a process computes under a kernel set."""
    command = [sys.executable, __file__, "--probe"]
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


def run_set(name: str, task: dict[str, Any]) -> list[KernelOutcome]:
    """All items under one kernel set."""
    with tempfile.TemporaryDirectory() as folder:
        asked, told = Path(folder) / "task.json", Path(folder) / "answers.pickle"
        asked.write_text(json.dumps(task))
        subprocess.run(
            [sys.executable, __file__, "--child", str(asked), str(told)],
            env=os.environ | SETS[name],
            check=True,
        )
        answers: list[KernelOutcome] = [KernelOutcome(**fields) for fields in pickle.loads(told.read_bytes())]
        return answers


def answer_all(asked: str, told: str) -> int:
    """In the process of one kernel set: reconstruct everything."""
    task = json.loads(Path(asked).read_text())
    answers = []
    for item in task["items"]:
        answers.append(answer(item, task["preset"], task["size"]).__dict__)
        print(os.environ["OPENBLAS_CORETYPE"], item, answers[-1]["error"], file=sys.stderr, flush=True)
    Path(told).write_bytes(pickle.dumps(answers))
    return 0


def answer(item: str, preset: str, size: list[int]) -> KernelOutcome:
    """Reconstruct one photo or world."""
    from physic_core.configuration.layers import is_path
    from physic_core.configuration.model import load_config
    from physic_core.errors import PhysicError
    from physic_core.pipeline.run import reconstruct
    from physic_testing.worlds import WORLDS, build_world

    name, _, seed = item.rpartition(":")
    chosen = {"file": preset} if is_path(preset) else {"preset": preset}
    config = load_config(**chosen, overrides=["run.cache=false"])
    try:
        photo = build_world(name, int(seed), (size[0], size[1])).image if name in WORLDS else item
        result = reconstruct(photo, config)
    except PhysicError as error:
        return KernelOutcome(error=str(error))
    floor = result.scene.floor
    return KernelOutcome(
        joints=np.array([person.joints for person in result.people]),
        floor=None if floor is None else np.array([*floor.normal, floor.offset]),
        contact=np.array([person.contact for person in result.people]),
        checks={(check.name, check.person): check.state for check in result.checks},
    )


@dataclass(frozen=True)
class Difference:
    """Of two answers about one photo; ``flips`` are checks that hold in one of them only."""

    joint_mm: float
    floor_deg: float
    contact: float
    flips: tuple[str, ...]

    @property
    def large(self) -> bool:
        """Whether it is beyond the limits."""
        beyond = self.joint_mm > JOINT_MM or self.floor_deg > FLOOR_DEG or self.contact > CONTACT_SHARE
        return bool(beyond or self.flips)


def difference(one: KernelOutcome, two: KernelOutcome) -> Difference:
    """Compare two answers; what cannot be compared is infinitely far apart."""
    if one.error or two.error:
        same = one.error == two.error
        return Difference(*([0.0] * 3 if same else [np.inf] * 3), () if same else (f"{one.error!r}/{two.error!r}",))
    if len(one.joints) != len(two.joints):
        return Difference(np.inf, np.inf, np.inf, (f"{len(one.joints)}/{len(two.joints)} people",))
    keys = sorted({*one.checks, *two.checks}, key=str)
    flips = [
        f"{name}{'' if person is None else f' of {person}'}: {one.checks.get((name, person))}/"
        f"{two.checks.get((name, person))}"
        for name, person in keys
        if one.checks.get((name, person), "none") != two.checks.get((name, person), "none")
    ]
    if not len(one.joints):
        return Difference(0.0, floor_angle(one.floor, two.floor), 0.0, tuple(flips))
    lost = np.isfinite(one.joints) != np.isfinite(two.joints)
    apart = np.linalg.norm(np.nan_to_num(one.joints) - np.nan_to_num(two.joints), axis=-1)
    return Difference(
        np.inf if lost.any() else 1000 * float(apart.max()),
        floor_angle(one.floor, two.floor),
        float((one.contact != two.contact).mean(axis=1).max()),
        tuple(flips),
    )


def floor_angle(one: Any, two: Any) -> float:
    """Degrees between two floors."""
    if one is None or two is None:
        return 0.0 if one is two else np.inf
    sine = np.linalg.norm(np.cross(one[:3], two[:3]))
    return float(np.degrees(np.arctan2(sine, one[:3] @ two[:3])))


def report(items: list[str], answers: dict[str, list[KernelOutcome]]) -> int:
    """Print a row a photo, the worst of the sets against the first; 1 where one is beyond the limits."""
    first, *others = answers
    print(f"{'against ' + first:44}{'joints mm':>10}{'floor deg':>10}{'contact %':>10}  checks that flip")
    large = 0
    for i, item in enumerate(items):
        for name in others:
            found = difference(answers[first][i], answers[name][i])
            large += found.large
            row = f"{Path(item).name[:32] + ' ' + name:44}{found.joint_mm:10.3f}{found.floor_deg:10.3f}"
            flips = "; ".join(found.flips)
            print(f"{row}{100 * found.contact:10.2f}  {flips}{'  <-- beyond' if found.large else ''}")
    print(f"{large} of {len(items) * len(others)} beyond {JOINT_MM:g} mm, {FLOOR_DEG} degrees, {CONTACT_SHARE:.0%}")
    return 1 if large else 0


if __name__ == "__main__":
    sys.exit(main())
