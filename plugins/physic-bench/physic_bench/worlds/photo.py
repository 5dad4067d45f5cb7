"""Processor time of one photo from a cold start, by part (``physic bench photo``).

Seconds depend on the machine. They are therefore also given as ratios to a yardstick that runs in the same process:
twenty passes of the packaged depth network in float32.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from physic_core.cache.folders import CACHE_VARIABLE
from physic_core.errors import PhysicError

if TYPE_CHECKING:
    from collections.abc import Iterator

YARDSTICK = "depth_anything_v2_vits"
"""File name of the yardstick's network, without its ending."""
YARDSTICK_PASSES = 20
"""Passes of the depth network in float32, at 252 x 252 px, in the yardstick."""
_IMPORTS_BESIDE = "imports beside the first network"


@dataclass(frozen=True)
class PhotoCost:
    """Medians over the repeats, processor seconds of all threads.

    Attributes:
        photo: its path.
        repeats: number of runs, each in a new process.
        total: from the start of the process to the written files.
        first_total: the same of the first run on a machine, which optimises the graphs of networks and keeps them.
        wall: the same, on the clock of the wall.
        memory_gb: peak memory of the process.
        yardstick: of the yardstick, which ``total`` does not contain.
        parts: the stages in order, with what starts the process, saving, and the rest.
        imports: of importing modules, as part of ``parts``.
        networks: of each network's file, as part of ``parts``: opening and running.
    """

    photo: str
    repeats: int
    total: float
    first_total: float
    wall: float
    memory_gb: float
    yardstick: float
    parts: dict[str, float]
    imports: float
    networks: dict[str, float]


def measure_photo(photo: Path, repeats: int = 5, *, preset: str = "embedded", report: bool = True) -> PhotoCost:
    """Reconstruct a photo and save the result, each time in a new process without cached results.

    Args:
        photo: the file.
        repeats: number of processes; medians are taken over them. Before them, one optimises the graphs of networks.
        preset: of the pipeline.
        report: whether the page of the result is written.

    Raises:
        PhysicError: a run fails, or does not use the network of the yardstick; the message has its last line.
    """
    with tempfile.TemporaryDirectory() as cache:
        first, *runs = [_run(photo, preset, report, cache) for _ in range(repeats + 1)]

    def medians(key: str) -> dict[str, float]:
        names = dict.fromkeys(name for run in runs for name in run[key])
        return {name: statistics.median(run[key].get(name, 0.0) for run in runs) for name in names}

    single = {
        key: statistics.median(run[key] for run in runs)
        for key in ("total", "wall", "memory_gb", "yardstick", "imports")
    }
    parts, networks = medians("parts"), medians("networks")
    return PhotoCost(str(photo), repeats, parts=parts, networks=networks, first_total=first["total"], **single)


def format_cost(cost: PhotoCost) -> str:
    """Return a table of the parts: processor seconds, and ratios to the yardstick."""
    rows: list[tuple[str, float | None]] = [*cost.parts.items(), ("total", cost.total)]
    rows += [("total of the first run on a machine", cost.first_total)]
    rows += [("", None), ("of these: imports", cost.imports)]
    networks = sorted(cost.networks.items(), key=lambda network: -network[1])
    rows += [(f"  {name}", seconds) for name, seconds in networks]
    rows += [("", None), (f"yardstick: {YARDSTICK_PASSES} passes of the depth network", cost.yardstick)]
    width = max(len(name) for name, _ in rows)
    lines = [f"{'':<{width}}  CPU s  yardsticks"]
    lines += [
        "" if seconds is None else f"{name:<{width}}  {seconds:5.2f}  {seconds / cost.yardstick:10.2f}"
        for name, seconds in rows
    ]
    return "\n".join([*lines, "", f"{cost.wall:.1f} s on the clock, {cost.memory_gb:.2f} GB, median of {cost.repeats}"])


def _run(photo: Path, preset: str, report: bool, cache: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder, "answer.json")
        arguments = json.dumps([str(photo), preset, report, str(Path(folder, "result")), str(answer)])
        start = "import gc; from physic_core.cli.process import GC_THRESHOLD; gc.set_threshold(GC_THRESHOLD); "
        start += f"from {__name__} import _measure; _measure(*__import__('json').loads({arguments!r}))"
        began = time.monotonic()
        place = {**os.environ, CACHE_VARIABLE: cache}
        done = subprocess.run([sys.executable, "-c", start], env=place, capture_output=True, text=True, check=False)
        if done.returncode or not answer.is_file():
            last = (done.stderr.strip() or "no output").rpartition("\n")[2]
            raise PhysicError(f"the measured run of {photo} ended with code {done.returncode}: {last}")
        found: dict[str, Any] = json.loads(answer.read_bytes())
        return found | {"wall": found["wall_end"] - began}


class _Meter:
    """Processor seconds by part, of imports, and by network; the paths of the opened networks."""

    def __init__(self) -> None:
        self.parts: defaultdict[str, float] = defaultdict(float)
        self.networks: defaultdict[str, float] = defaultdict(float)
        self.paths: list[Path] = []
        self.imports = 0.0
        self.imports_beside = 0.0
        self._part, self._since = "start", 0.0
        self._importing: set[int] = set()
        self._beside: dict[int, tuple[int, float]] = {}

    def begin(self, part: str) -> None:
        """End the current part and begin another."""
        now = self._now()
        self.parts[self._part] += now - self._since
        self._part, self._since = part, now

    @contextmanager
    def network(self, name: str) -> Iterator[None]:
        """Count the time of the block for a network."""
        start = self._now()
        yield
        self.networks[name] += self._now() - start

    def _now(self) -> float:
        """Return the seconds of the process without imports in other threads, which are a part of their own."""
        running = sum(time.clock_gettime(clock) - start for clock, start in self._beside.values())
        return time.process_time() - self.imports_beside - running

    def count_imports(self) -> None:
        """Count all imports from now on; those inside an import once."""
        import builtins

        real = builtins.__import__

        def counted(*arguments: Any, **keywords: Any) -> Any:
            thread = threading.get_ident()
            if thread in self._importing:
                return real(*arguments, **keywords)
            self._importing.add(thread)
            start = time.thread_time()
            if is_beside := threading.current_thread() is not threading.main_thread():
                self._beside[thread] = time.pthread_getcpuclockid(thread), start
            try:
                return real(*arguments, **keywords)
            finally:
                seconds = time.thread_time() - start
                self._importing.remove(thread)
                self.imports += seconds
                if is_beside:
                    self.imports_beside += seconds
                    del self._beside[thread]

        builtins.__import__ = counted

    def count_networks(self) -> None:
        """Count the opening and the runs of all ONNX files that are opened from now on."""
        from physic_core.adapters import onnx_sessions

        real_open: Callable[..., onnx_sessions.OnnxSession] = onnx_sessions.open_session
        real_run, names = onnx_sessions.OnnxSession.run, WeakKeyDictionary[onnx_sessions.OnnxSession, str]()

        def counted_open(path: Path, *arguments: Any, **keywords: Any) -> onnx_sessions.OnnxSession:
            with self.network(f"{path.stem}: open"):
                session = real_open(path, *arguments, **keywords)
            self.paths.append(path)
            names[session] = path.stem
            return session

        def counted_run(session: onnx_sessions.OnnxSession, *arguments: Any, **keywords: Any) -> Any:
            with self.network(names[session]):
                return real_run(session, *arguments, **keywords)

        onnx_sessions.open_session = counted_open
        onnx_sessions.OnnxSession.run = counted_run  # type: ignore[method-assign, assignment]


def _measure(photo: str, preset: str, report: bool, folder: str, answer: str) -> None:
    """Run in a new process: reconstruct, save, run the yardstick, and write the times to ``answer``."""
    import resource

    meter = _Meter()
    meter.count_imports()
    from physic_core import reconstruct

    meter.count_networks()
    meter.begin("reading")
    config = {"extends": preset, "run": {"cache": False}}
    result = reconstruct(photo, config, progress=lambda stage, number, of: meter.begin(stage))
    meter.begin("saving")
    result.save(folder)
    if report:
        result.report(f"{folder}/report.html", Path(photo).name)
    meter.begin("end")
    folders = [path.parent for path in meter.paths if path.stem.startswith(YARDSTICK)]
    if not folders:
        raise PhysicError(f"preset {preset!r} does not use {YARDSTICK!r}, the yardstick: choose one that does")
    wall_end, total = time.monotonic(), time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    found = {
        "parts": {**meter.parts, _IMPORTS_BESIDE: meter.imports_beside},
        "networks": dict(meter.networks),
        "imports": meter.imports,
        "total": total,
        "wall_end": wall_end,
        "memory_gb": memory,
        "yardstick": _yardstick(folders[0] / f"{YARDSTICK}.onnx"),
    }
    Path(answer).write_text(json.dumps(found), encoding="utf-8")


def _yardstick(path: Path) -> float:
    """Return the processor seconds of the yardstick; ``path`` is that of the packaged depth network in float32."""
    import numpy as np

    from physic_core.adapters import onnx_sessions

    session = onnx_sessions.open_session(path, 2, "cpu", broken="")
    image = {"image": np.zeros((1, 3, 252, 252), np.float32)}
    session.run(["depth"], image)
    start = time.process_time()
    for _ in range(YARDSTICK_PASSES):
        session.run(["depth"], image)
    return time.process_time() - start
