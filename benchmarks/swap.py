"""What it costs to exchange one estimator, when the cache has the results of an earlier run of the same photo.

    python -m benchmarks.swap PHOTO [--rounds 3] [--report]

Runs ``physic run PHOTO`` with an empty cache, then, for each exchange, again with the cache of that run. Prints the
processor seconds of all threads (medians of the rounds), their share of the whole run, and the stages whose backend was
called. The optimised graphs of networks are kept in all runs.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.processes import run_measured
from physic_core.cache.folders import CACHE_VARIABLE, CACHES

SWAPS = {
    "nothing": (),
    "inpainter: telea": ("inpainter.backend=telea",),
    "keypoints of its own": ("keypoint_detector.options.reuse=false",),
    "hands from 24 px": ("hand_estimator.options.least_size_px=24",),
}
"""Settings that differ, by name. They need no weights but the packaged ones; all but "nothing" change one result."""


def run(
    photo: Path, cache: Path, bytecode: Path, settings: tuple[str, ...], *, report: bool
) -> tuple[float, list[str]]:
    """Run in a new process; return its processor seconds and the stages whose backend was called."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "physic_core", "run", str(photo), "-o", f"{folder}/out"]
        command += [
            *(argument for one in settings for argument in ("--set", one)),
            "--report" if report else "--no-report",
        ]
        # Installed packages have their bytecode, whatever the environment of this process says.
        place = {**os.environ, CACHE_VARIABLE: str(cache), "PYTHONDONTWRITEBYTECODE": ""}
        place["PYTHONPYCACHEPREFIX"] = str(bytecode)
        cost = run_measured(command, env=place)
        document = json.loads(Path(folder, "out", "reconstruction.json").read_bytes())
    called = [stage["name"] for stage in document["stages"] if stage["provenance"] and not stage["cached"]]
    return cost.cpu_s, called


def main() -> None:
    """Measure and print a row for each exchange."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("photo", type=Path)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--report", action="store_true", help="write the page, too")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        results = CACHES["results"][0]
        graphs, warm, other, code = (Path(place, name) for name in ("graphs", "warm", "other", "bytecode"))
        for settings in SWAPS.values():  # optimises the graphs of all networks
            run(given.photo, graphs, code, settings, report=given.report)
        shutil.rmtree(graphs / results)
        whole, costs, called = list[float](), {name: list[float]() for name in SWAPS}, dict[str, list[str]]()
        for _ in range(given.rounds):
            shutil.copytree(graphs, warm)
            whole.append(run(given.photo, warm, code, (), report=given.report)[0])
            for name, settings in SWAPS.items():
                shutil.copytree(warm, other)
                seconds, called[name] = run(given.photo, other, code, settings, report=given.report)
                costs[name].append(seconds)
                shutil.rmtree(other)
            shutil.rmtree(warm)
    total = statistics.median(whole)
    print(f"{'exchanged':26}{'CPU s':>7}{'of whole':>10}  called")
    print(f"{'whole photo':26}{total:7.2f}{1:10.0%}  all")
    for name, seconds in costs.items():
        middle = statistics.median(seconds)
        print(f"{name:26}{middle:7.2f}{middle / total:10.0%}  {', '.join(called[name]) or 'none'}")


if __name__ == "__main__":
    main()
