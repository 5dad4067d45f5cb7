"""Processor time of one photo from a cold start, by part and by network.

    python -m benchmarks.photo PHOTO [--repeats 5] [--preset embedded] [--no-report] [--json]

Each repeat is a new process without cached results; medians are taken over them. Before them, one run optimises the
graphs of networks, which all others find. Seconds depend on the machine, so they are also given as ratios to a
yardstick that runs in the same process: twenty passes of the packaged depth network in float32.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from physic_core.cache.folders import CACHE_VARIABLE
from physic_core.errors import PhysicError

YARDSTICK, PASSES = "depth_anything_v2_vits", 20
CHILD = "from benchmarks.photo import measure; measure(*__import__('json').loads({!r}))"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.photo", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("photo", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--preset", default="embedded", help="of the pipeline; it must use the packaged depth network")
    parser.add_argument("--no-report", action="store_true", help="write no page")
    parser.add_argument("--json", action="store_true", help="print every number as JSON")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache:
        first, *runs = [run(given, cache) for _ in range(given.repeats + 1)]
    cost = {key: middle([one[key] for one in runs]) for key in first} | {"first_total": first["total"]}
    print(json.dumps(cost, indent=2) if given.json else text_of(cost))


def middle(values: list[Any]) -> Any:
    """Return the median of numbers, or of dictionaries of numbers."""
    if not isinstance(values[0], dict):
        return statistics.median(values)
    return {name: statistics.median(one.get(name, 0.0) for one in values) for name in values[0]}


def run(given: argparse.Namespace, cache: str) -> dict[str, Any]:
    """Measure in a new process."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder, "answer.json")
        asked = json.dumps([str(given.photo), given.preset, not given.no_report, f"{folder}/result", str(answer)])
        began = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-c", CHILD.format(asked)],
            env={**os.environ, CACHE_VARIABLE: cache},
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        if done.returncode:
            raise SystemExit(f"the measured run ended with code {done.returncode}: {done.stderr.strip()[-300:]}")
        found: dict[str, Any] = json.loads(answer.read_bytes())
    return found | {"wall": found["wall"] - began}


class Meter:
    """Processor seconds by part and by network, and the files of the opened networks."""

    def __init__(self) -> None:
        self.parts: defaultdict[str, float] = defaultdict(float)
        self.networks: defaultdict[str, float] = defaultdict(float)
        self.paths: list[Path] = []
        self._part, self._since = "start", 0.0

    def begin(self, part: str) -> None:
        """End the current part and begin another."""
        now = time.process_time()
        self.parts[self._part] += now - self._since
        self._part, self._since = part, now

    def count_networks(self) -> None:
        """Count the opening and the runs of all ONNX files that are opened from now on."""
        from physic_core.adapters import onnx_sessions

        real_open, real_run = onnx_sessions.open_session, onnx_sessions.OnnxSession.run
        names = WeakKeyDictionary[onnx_sessions.OnnxSession, str]()

        def counted(name: str, function: Any, *arguments: Any, **keywords: Any) -> Any:
            start = time.process_time()
            result = function(*arguments, **keywords)
            self.networks[name] += time.process_time() - start
            return result

        def counted_open(path: Path, *arguments: Any, **keywords: Any) -> onnx_sessions.OnnxSession:
            session: onnx_sessions.OnnxSession = counted(f"{path.stem}: open", real_open, path, *arguments, **keywords)
            self.paths.append(path)
            names[session] = path.stem
            return session

        def counted_run(session: onnx_sessions.OnnxSession, *arguments: Any, **keywords: Any) -> Any:
            return counted(names[session], real_run, session, *arguments, **keywords)

        onnx_sessions.open_session = counted_open
        onnx_sessions.OnnxSession.run = counted_run  # type: ignore[method-assign, assignment]


def measure(photo: str, preset: str, report: bool, folder: str, answer: str) -> None:
    """Run in a new process: reconstruct, save, run the yardstick, and write the times to ``answer``."""
    import resource

    from physic_core import reconstruct

    meter = Meter()
    meter.count_networks()
    meter.begin("reading")
    config = {"extends": preset, "run": {"cache": False}}
    result = reconstruct(photo, config, progress=lambda stage, number, of: meter.begin(stage))
    meter.begin("saving")
    result.save(folder)
    if report:
        result.report(f"{folder}/report.html", Path(photo).name)
    meter.begin("end")
    wall, total = time.monotonic(), time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    found = {"parts": meter.parts, "networks": dict(meter.networks), "total": total, "wall": wall, "memory_gb": memory}
    Path(answer).write_text(json.dumps(found | {"yardstick": yardstick(meter.paths, preset)}), encoding="utf-8")


def yardstick(paths: list[Path], preset: str) -> float:
    """Return the processor seconds of the yardstick, whose network is among the files that were opened."""
    import numpy as np

    from physic_core.adapters import onnx_sessions

    folders = [path.parent for path in paths if path.stem.startswith(YARDSTICK)]
    if not folders:
        raise PhysicError(f"preset {preset!r} does not use {YARDSTICK!r}, the yardstick: choose one that does")
    session = onnx_sessions.open_session(folders[0] / f"{YARDSTICK}.onnx", 2, "cpu", broken="")
    image = {"image": np.zeros((1, 3, 252, 252), np.float32)}
    session.run(["depth"], image)
    start = time.process_time()
    for _ in range(PASSES):
        session.run(["depth"], image)
    return time.process_time() - start


def text_of(cost: dict[str, Any]) -> str:
    """Return a table of parts and networks: processor seconds, and ratios to the yardstick."""
    networks = sorted(cost["networks"].items(), key=lambda network: -network[1])
    rows = [
        *cost["parts"].items(),
        ("total", cost["total"]),
        ("total of the first run on a machine", cost["first_total"]),
        *((f"  of these: {name}", seconds) for name, seconds in networks),
        (f"yardstick: {PASSES} passes of the depth network", cost["yardstick"]),
    ]
    width = max(len(name) for name, _ in rows)
    lines = [f"{'':<{width}}  CPU s  yardsticks"]
    lines += [f"{name:<{width}}  {seconds:5.2f}  {seconds / cost['yardstick']:10.2f}" for name, seconds in rows]
    return "\n".join([*lines, "", f"{cost['wall']:.1f} s on the clock, {cost['memory_gb']:.2f} GB"])


if __name__ == "__main__":
    main()
