"""What a photo costs: processor time, memory and files of ``physic run PHOTO --no-cache``, the median of some runs.

    python -m benchmarks.run_cost [--rounds 3]

It writes ``benchmarks/run_cost.json`` with the commit and the machine, and the line of the README that states them. Run
it on an idle machine, with everything committed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

import docs_numbers
from docs_numbers import ROOT

from benchmarks.processes import run_measured

PHOTOS = ("examples/slope.jpg", "examples/couple.jpg")
"""One person and two, both 1280 px on the long side once the tool has read them."""
CODE = ("physic_core", "plugins")
"""What the figures are of: the last commit that changed it is named."""


def run(photo: str) -> dict[str, float]:
    """Return processor seconds, peak memory in GB and megabytes of files of one run."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "physic_core", "run", photo, "--no-cache", "-o", f"{folder}/out"]
        cost = run_measured(command, cwd=ROOT)
        files = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
    return {"cpu_s": cost.cpu_s, "memory_gb": cost.memory_gb, "written_mb": files / 1e6}


def git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Measure, write, and print what was written."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    if git("status", "--porcelain", "--untracked-files=no", "--", *CODE):
        raise SystemExit("the code differs from its commit, which the figures name: commit first")
    measured = {}
    for photo in PHOTOS:
        rounds = [run(photo) for _ in range(given.rounds)]
        measured[photo] = {key: round(statistics.median(one[key] for one in rounds), 1) for key in rounds[0]}
    cost = {
        "commit": docs_numbers.commit_of_code(),
        "date": git("log", "-1", "--format=%cs", "--", *CODE),
        "machine": f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}",
        "load": round(os.getloadavg()[0], 1),
        "rounds": given.rounds,
        "photos": measured,
    }
    docs_numbers.COST.write_text(json.dumps(cost, indent=2) + "\n", encoding="utf-8")
    docs_numbers.write_lines()
    print(docs_numbers.cost_line(cost))


if __name__ == "__main__":
    main()
