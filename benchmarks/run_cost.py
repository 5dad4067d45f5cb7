"""What a photo costs: processor time, memory and files of ``physic run PHOTO --no-cache``, the
median of some runs.

    python -m benchmarks run_cost [--rounds 3] [--against COMMIT [PHOTO ...]]

It writes ``benchmarks/run_cost.json`` with the commit and the machine, and the line of the README
that states them. Run it on an idle machine, with everything committed.

With ``--against`` it writes nothing. It runs another commit in turn with this tree, in the same
environment, and prints the medians of both, their ratios, the largest difference of the bodies, and
which files only one of them writes: a distribution that is not installed makes none. Photos take
the place of the two examples; a folder is the five of its photos whose SHA-256 is smallest.
"""

from __future__ import annotations

import compileall
import hashlib
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

import docs_numbers
import numpy as np
import pages
from docs_numbers import CODE, ROOT, git

from benchmarks.fits import parser_of

PHOTOS = ("examples/slope.jpg", "examples/couple.jpg")
"""One person and two, both 1280 px on the long side once the tool has read them."""


QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@dataclass(frozen=True)
class Run:
    """What one run costs, and what it finds.

    Attributes:
        cost: seconds of processors, peak memory in GB, megabytes of files.
        vertices: (N, V, 3) of the bodies, metres.
        files: names of what is written.
    """

    cost: dict[str, float]
    vertices: np.ndarray
    files: frozenset[str]


def run(photo: str, tree: Path = ROOT) -> Run:
    """Run the code of a tree on a photo of this one, its modules compiled as an installation has
    them.
    """
    for folder in CODE:
        compileall.compile_dir(tree / folder, quiet=2)
    paths = [tree, *sorted(path.parent for path in tree.glob("plugins/*/pyproject.toml"))]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "physic_core", "run", str(ROOT / photo), "--no-cache"]
        command += ["-o", f"{folder}/out"]
        process = subprocess.Popen(command, cwd=tree, env=environment, **QUIET)
        _, status, usage = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"`{' '.join(command)}` failed")
        files = [file for file in Path(folder).rglob("*") if file.is_file()]
        size = sum(file.stat().st_size for file in files)
        with np.load(Path(folder, "out", "reconstruction.npz"), allow_pickle=False) as arrays:
            vertices = np.stack(
                [arrays[name] for name in sorted(arrays.files) if name.endswith(".vertices")]
            )
    return Run(
        {
            "cpu_s": usage.ru_utime + usage.ru_stime,
            "memory_gb": usage.ru_maxrss / 2**20,  # as Linux counts
            "written_mb": size / 1e6,
        },
        vertices,
        frozenset(file.name for file in files),
    )


def medians(runs: list[Run]) -> dict[str, float]:
    return {key: statistics.median(one.cost[key] for one in runs) for key in runs[0].cost}


@contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """Yield a folder with the files of a commit."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder, "tree")
        git("worktree", "add", "--detach", str(tree), commit)
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))


def compare(commit: str, rounds: int, photos: Sequence[str]) -> None:
    """Run another commit and this tree in turn, and print a row for each figure of each photo."""
    sums = [0.0, 0.0]
    with checkout(commit) as tree:
        for photo in photos:
            before: list[Run] = []
            after: list[Run] = []
            for _ in range(rounds):
                before.append(run(photo, tree))
                after.append(run(photo))
            old = medians(before)
            new = medians(after)
            for key, value in new.items():
                print(
                    f"{photo}  {key}: {old[key]:.2f} -> {value:.2f}, ratio {value / old[key]:.3f}",
                    flush=True,
                )
            print(
                f"{photo}  bodies: {_difference(before[-1].vertices, after[-1].vertices)}",
                flush=True,
            )
            if alone := sorted(before[-1].files ^ after[-1].files):
                print(f"{photo}  files of one alone: {', '.join(alone)}", flush=True)
            sums = [sums[0] + old["cpu_s"], sums[1] + new["cpu_s"]]
    print(f"all  cpu_s: {sums[0]:.2f} -> {sums[1]:.2f}, ratio {sums[1] / sums[0]:.3f}")


def photos_of(path: Path) -> list[str]:
    """Return a photo, or the five of a folder whose SHA-256 is smallest."""
    if not path.is_dir():
        return [str(path.resolve())]
    files = [file for file in path.iterdir() if file.suffix.lower() in (".jpg", ".jpeg", ".png")]
    files.sort(key=lambda file: hashlib.sha256(file.read_bytes()).hexdigest())
    return [str(file.resolve()) for file in files[:5]]


def _difference(before: np.ndarray, after: np.ndarray) -> str:
    if before.shape != after.shape:
        return f"not the same people: {before.shape} and {after.shape}"
    return f"largest difference {np.abs(before - after).max() * 1000:.3f} mm"


def main() -> None:
    """Measure, write, and print what was written."""
    parser = parser_of("run_cost", __doc__, fits=False)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--against",
        nargs="+",
        metavar=("COMMIT", "PHOTO"),
        help="run this commit in turn, on these photos or the two examples, and write nothing",
    )
    given = parser.parse_args()
    if given.against is not None:
        commit, *photos = given.against
        chosen = [photo for path in photos for photo in photos_of(Path(path))]
        compare(commit, given.rounds, chosen or PHOTOS)
        return
    if git("status", "--porcelain", "--untracked-files=no", "--", *CODE):
        raise SystemExit("the code differs from its commit, which the figures name: commit first")
    measured = {}
    for photo in PHOTOS:
        medians_of_photo = medians([run(photo) for _ in range(given.rounds)])
        measured[photo] = {key: round(value, 1) for key, value in medians_of_photo.items()}
    cost = {
        "commit": docs_numbers.commit_of_code(),
        "date": git("log", "-1", "--format=%cs", "--", *CODE),
        "machine": f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}",
        "load": round(os.getloadavg()[0], 1),
        "rounds": given.rounds,
        "photos": measured,
    }
    figures = {**pages.figures(), "cost": cost}
    pages.FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    pages.write_pages()
    print(pages.cost_line())
