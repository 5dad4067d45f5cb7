"""How long ``physic --help`` and ``physic plugins`` take with fifty plugins installed, one of them broken, one slow.

    python benchmarks/startup.py [--plugins 50] [--rounds 15]

The plugins are made in a temporary folder, as pip would leave them. Each command is started afresh, the commands in
turn, so that a busy machine slows all alike; medians, and processor time beside the time on the clock.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SLOW_SECONDS = 0.3
INTERFACES = ("segmenter", "inpainter", "metric_depth", "relative_pointmap", "keypoint_detector", "body_estimator")
HOOK = """
from physic_core import BackendRecord, hookimpl
{first}
@hookimpl
def physic_backends():
    return [BackendRecord("{interface}", "dummy-{number}", "{module}.backend:Dummy", api=1, summary="Nothing")]
"""


def install(folder: Path, number: int, first: str = "") -> None:
    """Leave what pip would leave of a plugin with one backend, whose module fails if it is imported."""
    module = f"physic_dummy_{number}"
    interface = INTERFACES[number % len(INTERFACES)]
    (folder / module).mkdir()
    (folder / module / "__init__.py").write_text(
        HOOK.format(first=first, interface=interface, number=number, module=module)
    )
    (folder / module / "backend.py").write_text("raise AssertionError('a listing imports no backend')\n")
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: physic-dummy-{number}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[physic.plugins]\ndummy-{number} = {module}\n")


def measure(command: list[str], environment: dict[str, str]) -> tuple[float, float]:
    """Seconds on the clock and of processor time."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    clock, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--plugins", type=int, default=50)
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    physic = [sys.executable, "-c", "from physic_core.cli import main; main()"]
    with tempfile.TemporaryDirectory() as place:
        plain, slow, one_broken = (Path(place) / name for name in ("plain", "slow", "broken"))
        for folder in (plain, slow, one_broken):
            folder.mkdir()
        for number in range(given.plugins - 2):
            install(plain, number)
        install(one_broken, given.plugins - 2, "import no_such_module")
        install(slow, given.plugins - 1, f"import time; time.sleep({SLOW_SECONDS})")
        few = os.environ | {"PYTHONPATH": ""}
        most = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (plain, one_broken)))}
        every = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (plain, one_broken, slow)))}
        listed = subprocess.run([*physic, "plugins"], env=every, check=True, capture_output=True, text=True).stdout
        assert listed.count("dummy-") >= given.plugins - 1, listed
        assert "BROKEN: ModuleNotFoundError: No module named 'no_such_module'" in listed
        rows = {
            "python -c pass": ([sys.executable, "-c", "pass"], few),
            "physic --help, none of them": ([*physic, "--help"], few),
            "physic plugins, none of them": ([*physic, "plugins"], few),
            f"physic --help, {given.plugins}": ([*physic, "--help"], every),
            f"physic plugins, {given.plugins - 1}, one broken": ([*physic, "plugins"], most),
            f"physic plugins, {given.plugins}, one broken, one that sleeps {SLOW_SECONDS} s": (
                [*physic, "plugins"],
                every,
            ),
        }
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in rows}
        for turn in range(given.rounds + 1):
            for name, (command, environment) in rows.items():
                taken = measure(command, environment)
                if turn:  # the first round compiles
                    found[name].append(taken)
    bare = statistics.median(clock for clock, _ in found["python -c pass"])
    print(f"{'':<64} {'clock':>8} {'least':>8} {'processor':>10} {'over bare':>10}")
    for name, taken in found.items():
        clock = statistics.median(c for c, _ in taken)
        processor = statistics.median(p for _, p in taken)
        print(f"{name:<64} {clock:7.3f}s {min(c for c, _ in taken):7.3f}s {processor:9.3f}s {clock - bare:9.3f}s")


if __name__ == "__main__":
    main()
