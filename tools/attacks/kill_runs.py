"""Kill ``physic run`` and ``physic batch`` at random moments: ``python tools/attacks/kill_runs.py [--kills 60]``.

Half of the moments are spread over the time of a command, half are while it writes. After each kill (SIGKILL), the
output folder must hold complete results only. A batch is then resumed until it ends; its journal must have one row for
each photo, and its files must be those of a batch that nothing interrupted.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from PIL import Image

from physic_core.batch.journal import read_rows
from physic_core.errors import InputError
from physic_core.files.atomic import committed_path
from physic_core.io.result_folder import file_digest
from physic_core.io.results import load_reconstruction, read_document
from physic_testing.worlds import build_world

PHYSIC = (sys.executable, "-P", "-m", "physic_core")
SETTINGS = ("--preset", "mock", "--set", "engine.joint.optimiser.steps=3")
RUN = ("run", "photo.png", "-o", "out", *SETTINGS)
BATCH = ("batch", "photos", "-o", "batch", "--workers", "2", "--table", "csv", *SETTINGS)
WORLDS = ("stand", "walk", "kneel", "squat")
LONGEST_S = 600
"""Limit of one command."""


def start(*words: str, folder: Path) -> subprocess.Popen[bytes]:
    """Start a command in a session of its own; its output is in ``output.txt``."""
    environment = os.environ | {"PHYSIC_CACHE": "off", "OMP_NUM_THREADS": "1"}
    with (folder / "output.txt").open("wb") as output:
        return subprocess.Popen(
            (*PHYSIC, *words), cwd=folder, env=environment, stdout=output, stderr=output, start_new_session=True
        )


def wait_for_moment(process: subprocess.Popen[bytes], out: Path, seconds: float) -> bool:
    """Wait for a random moment; return whether the process still runs.

    Args:
        process: of the command.
        out: its output folder.
        seconds: how long the command runs if nothing interrupts it.
    """
    end, is_writing = time.monotonic() + LONGEST_S, random.random() < 0.5
    if is_writing:
        new = time.time()
        while process.poll() is None and time.monotonic() < end and not is_written(out, new):
            time.sleep(0.002)
    with suppress(subprocess.TimeoutExpired):
        process.wait(random.uniform(0, 0.3 if is_writing else seconds))
    return process.poll() is None


def is_written(out: Path, since: float) -> bool:
    with suppress(OSError):
        return any(path.name.endswith(".physic-part") and path.lstat().st_mtime >= since for path in out.rglob(".*"))
    return False


def kill_group(process: subprocess.Popen[bytes]) -> None:
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def kill_first(process: subprocess.Popen[bytes]) -> None:
    """Kill the command, and wait until its workers have ended by themselves."""
    process.kill()
    process.wait()
    for _ in range(600):
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("processes of a command that was killed are still running after 30 s")


def kill_worker(process: subprocess.Popen[bytes]) -> None:
    """Kill one of the processes that a command started, if there is one."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    if children:
        with suppress(ProcessLookupError):
            os.kill(int(random.choice(children)), signal.SIGKILL)


def fault_of(folder: Path) -> str:
    """Return what is wrong with a result; "" if it is complete."""
    try:
        load_reconstruction(folder)
        document = read_document(folder)
    except InputError as error:
        return str(error)
    digests = document["digests"]
    wrong = [name for name, digest in digests.items() if file_digest(committed_path(folder, name)) != digest]
    return f"{', '.join(wrong)} of {folder} are not of its result" if wrong else ""


def fault_of_batch(out: Path) -> str:
    """Return what is wrong with the results of a batch that was interrupted; "" if each is complete."""
    for name, row in read_rows(out).items():
        if row["state"] == "done" and (fault := fault_of(out / row["folder"])):
            return f"{name}: {fault}"
    for path in out.glob("photos/*/*"):
        if any(path.glob("[!.]*")) and (fault := fault_of(path)):
            return fault
    for path in out.glob("thumbnails/*/[!.]*"):
        with Image.open(path) as picture:
            picture.load()
    return ""


def fault_of_end(out: Path, photos: int, files: set[str]) -> str:
    """Return what is wrong with a batch that has ended; "" for nothing."""
    count = Counter(read_lines(out))
    if len(count) != photos or set(count.values()) != {1}:
        return f"rows of the journal: {dict(count)}"
    if (found := files_of(out)) != files:
        return f"files that only one of the batches has: {sorted(found ^ files)}"
    return fault_of_batch(out)


def read_lines(out: Path) -> Iterator[str]:
    """Yield the id of each row, those of an id that has several too."""
    with tempfile.TemporaryDirectory() as folder:
        for line in (out / "journal.jsonl").read_bytes().splitlines(keepends=True):
            Path(folder, "journal.jsonl").write_bytes(line)
            yield from read_rows(Path(folder))


def files_of(out: Path) -> set[str]:
    paths = (path.relative_to(out) for path in out.rglob("*") if path.is_file())
    return {str(path) for path in paths if path.parts[0] != "logs"}


def error_in(folder: Path, ended: int) -> str:
    lines = (folder / "output.txt").read_text(errors="replace").splitlines() or [""]
    return f"it ended with {ended}: {lines[-1]}"


def kill_run(folder: Path, seconds: float) -> tuple[bool, str]:
    """Start a run over a result of an earlier one; return whether it was killed, and what is wrong."""
    out = folder / "out"
    if random.random() < 0.3:
        shutil.rmtree(out, ignore_errors=True)
    before = (out / "reconstruction.json").exists()
    process = start(*RUN, folder=folder)
    is_killed = wait_for_moment(process, out, seconds)
    if is_killed:
        kill_group(process)
    elif process.returncode:
        return False, error_in(folder, process.returncode)
    if not before and is_killed and not committed_path(out, "reconstruction.json").exists():
        left = [path.name for path in out.glob("[!.]*")]
        return True, f"{left} without a result" if left else ""
    return is_killed, fault_of(out)


def kill_batch(folder: Path, seconds: float, files: set[str]) -> tuple[bool, str]:
    """Start or resume a batch; return whether one of its processes was killed, and what is wrong."""
    out = folder / "batch"
    process = start(*BATCH, folder=folder)
    is_killed = wait_for_moment(process, out, seconds)
    kill = random.choice((kill_group, kill_first, kill_worker))
    if is_killed:
        kill(process)
        if kill is not kill_worker:
            return True, fault_of_batch(out)
        process.wait(LONGEST_S)
    if process.returncode:
        text = error_in(folder, process.returncode)
        # The first worker decides whether the backends can be loaded.
        is_first = is_killed and "a worker ended while it loaded the backends: it was ended by SIGKILL" in text
        return is_killed, "" if is_first else text
    fault = fault_of_end(out, len(WORLDS) + 1, files)
    if not fault:
        shutil.rmtree(out)
    return is_killed, fault


def run_to_the_end(folder: Path, words: tuple[str, ...]) -> None:
    if ended := start(*words, folder=folder).wait(LONGEST_S):
        raise SystemExit(f"without a kill: {error_in(folder, ended)}")


def prepare(folder: Path) -> tuple[float, float, set[str]]:
    """Write photos; return the time of a run, that of a batch, and the files of a batch."""
    (folder / "photos").mkdir()
    for name in WORLDS:
        Image.fromarray(build_world(name, size=(96, 72)).image).save(folder / "photos" / f"{name}.png")
    (folder / "photos" / "broken.png").write_text("no photo")
    shutil.copy(folder / "photos" / "stand.png", folder / "photo.png")
    begin = time.monotonic()
    run_to_the_end(folder, RUN)
    middle = time.monotonic()
    run_to_the_end(folder, BATCH)
    end = time.monotonic()
    out = folder / "batch"
    files = files_of(out)
    if fault := fault_of(folder / "out") or fault_of_end(out, len(WORLDS) + 1, files):
        raise SystemExit(f"without a kill: {fault}")
    shutil.rmtree(out)
    return middle - begin, end - middle, files


def main() -> int:
    """Kill and resume; return 1 if a result or a journal was incomplete."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=60, help="of runs, and of batches")
    parser.add_argument("--minutes", type=float, default=1e6, help="end after this time")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings/kill_runs"))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    begin = time.monotonic()
    failed = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        of_run, of_batch, files = prepare(folder)
        attacks: dict[str, Callable[[], tuple[bool, str]]] = {
            "run": lambda: kill_run(folder, of_run),
            "batch": lambda: kill_batch(folder, of_batch, files),
        }
        for part, (name, attack) in enumerate(attacks.items(), start=1):
            started = killed = faults = 0
            while killed < given.kills and time.monotonic() - begin < 60 * given.minutes * part / len(attacks):
                started += 1
                is_killed, fault = attack()
                killed += is_killed
                if fault:
                    faults += 1
                    kept = given.keep / f"{name}-{started}"
                    shutil.rmtree(kept, ignore_errors=True)
                    shutil.copytree(folder, kept)
                    (kept / "fault.txt").write_text(fault + "\n")
                    print(f"FAILED {name} {started}: {fault}", flush=True)
                    for path in (folder / "out", folder / "batch"):
                        shutil.rmtree(path, ignore_errors=True)
            print(f"physic {name}: {started} started, {killed} killed, {faults} failed", flush=True)
            failed += faults
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
