"""Run a batch of photos of which most break something: ``python tests/attacks/broken_batch.py [--count N]``.

Photos are cut off, empty, bombs, pipes or no pictures; backends return what no interface allows, raise,
hang, end or kill their worker; and workers are killed from outside. The batch must end by itself, its journal must
have one row for each photo with the expected state, and each photo without a fault must have its result.
After ``--minutes`` the batch is interrupted as by Ctrl-C, and the rows until then are compared.
"""

from __future__ import annotations

import argparse
import io
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
from PIL import Image

from faulty import ENDING, FAULTS, HANGING, RAISING, SETTINGS, mark, photo
from fuzzing import photo_bombs
from physic_core.batch.journal import read_rows
from physic_core.errors import InputError
from physic_core.io.results import load_reconstruction

WORKERS = 2
INTERRUPTED = 130
"""Exit status after Ctrl-C."""

PHYSIC = (sys.executable, "-P", "-m", "physic_core")


def png(image: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(image).save(file, "PNG")
    return file.getvalue()


def broken_photos(good: bytes) -> dict[str, Callable[[Path], object]]:
    """Return what writes a photo that cannot be read, by name."""
    contents = {
        "empty": b"",
        "text": b"no photo",
        "cut off": good[: len(good) // 2],
        "header alone": good[:40],
        "zeros": bytes(10_000),
        "webp bomb": photo_bombs.webp(),
        "jpeg2000 bomb": photo_bombs.jpeg2000(),
        "flipped": good[:60] + bytes([good[60] ^ 255]) + good[61:],
        "tiny": png(np.zeros((5, 5, 3), np.uint8)),
    }
    found: dict[str, Callable[[Path], object]] = {
        name: lambda path, content=content: path.write_bytes(content)  # type: ignore[misc]
        for name, content in contents.items()
    }
    return found | {"pipe": os.mkfifo, "broken link": lambda path: path.symlink_to("nowhere")}


def write_photos(folder: Path, count: int) -> dict[str, str]:
    """Write photos; return for each name the class of its error, or "" for a result.

    Of ten photos, four are good, three cannot be read, and three have a fault. Each fault occurs in turn, those that
    end a worker or hang, which take long, once in fifty photos.
    """
    good = png(photo())
    broken = itertools.cycle(broken_photos(good).items())
    slow = itertools.cycle([*ENDING, *HANGING])
    done_otherwise = {*RAISING, *ENDING, *HANGING}
    refused = [name for name, (_, error, _) in FAULTS.items() if error and name not in done_otherwise]
    used = [name for name, (_, error, _) in FAULTS.items() if not error]
    faults = itertools.cycle(random.sample(list(RAISING), len(RAISING)) + random.sample(refused, len(refused)))
    deviating = itertools.cycle(random.sample(used, len(used)))
    expected: dict[str, str] = {}
    for number in range(count):
        name = f"{number:05d}.png"
        path, kind = folder / name, number % 10
        if number % 50 == 15 or (kind in (5, 7, 9) and number % 50 != 19):
            fault = next(slow) if number % 50 == 15 else next(faults)
            path.write_bytes(png(mark(fault)))
            expected[name] = FAULTS[fault][1]
        elif number % 50 == 19:
            path.write_bytes(png(mark(next(deviating))))
            expected[name] = ""
        elif kind in (1, 3, 6):
            next(broken)[1](path)
            expected[name] = "InputError"
        else:
            path.write_bytes(good)
            expected[name] = ""
    return expected


def start(folder: Path, timeout_s: float) -> subprocess.Popen[bytes]:
    environment = os.environ | {"PHYSIC_CACHE": "off", "PYTHONPATH": _path(), "OMP_NUM_THREADS": "1"}
    words = ["batch", "photos.csv", "-o", "out", "--preset", "mock", "--workers", str(WORKERS), "--table", "csv"]
    words += itertools.chain.from_iterable(("--set", text) for text in (*SETTINGS, f"run.timeout_s={timeout_s:g}"))
    with (folder / "output.txt").open("ab") as output:
        return subprocess.Popen((*PHYSIC, *words), cwd=folder, env=environment, stdout=output, stderr=output)


def _path() -> str:
    return os.pathsep.join(filter(None, (str(Path(__file__).parent), os.environ.get("PYTHONPATH"))))


def kill_workers(process: subprocess.Popen[bytes], journal: Path, expected: dict[str, str], pause_s: float) -> int:
    """Kill a worker from outside now and then until the batch ends; return how often.

    Photos whose worker died are tried a second and last time after all others. No worker is killed from then on, lest a
    good photo loses both of its workers.
    """
    killed, ending = 0, sum(error == "WorkerDied" for error in expected.values())
    while True:
        try:
            process.wait(random.uniform(0.5, 1.5) * pause_s)
            return killed
        except subprocess.TimeoutExpired:
            with suppress(OSError):
                left = len(expected) - journal.read_bytes().count(b"\n")
                if left <= killed + ending + 2 * WORKERS:
                    continue
                children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
                workers = [int(pid) for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
                if len(workers) > 1:  # the only one would decide that the backends cannot be loaded
                    os.kill(random.choice(workers), signal.SIGKILL)
                    killed += 1


def faults_of(out: Path, expected: dict[str, str]) -> Iterator[str]:
    """Yield what is wrong with the journal and the results."""
    rows = {Path(row["path"]).name: row for row in read_rows(out).values()}
    lines = (out / "journal.jsonl").read_bytes().count(b"\n")
    if set(rows) != set(expected) or lines != len(expected):
        yield f"{len(rows)} photos in {lines} lines of the journal, and {len(expected)} photos"
    for name, row in rows.items():
        if len(row["message"]) > 5000:
            yield f"{name}: a message of {len(row['message'])} characters"
        if row["error"] != expected.get(name) or (row["state"] == "done") != (not row["error"]):
            yield f"{name}: {row['state']} {row['error']} {row['message'][:300]}, not '{expected.get(name)}'"
        elif not row["error"]:
            try:
                load_reconstruction(out / row["folder"])
            except InputError as error:
                yield f"{name}: {error}"
    for path in out.glob("photos/*/*"):
        if left := [file.name for file in path.glob(".*")]:
            yield f"{path}: left behind {left}"


def main() -> int:
    """Run the batch; return 1 if a row or a result is missing or wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=100, help="photos")
    parser.add_argument("--minutes", type=float, default=60, help="interrupt the batch after so long")
    parser.add_argument("--timeout-s", type=float, default=20, help="limit of a call of a backend")
    parser.add_argument("--kill-every", type=float, default=60, metavar="S", help="kill a worker about every S seconds")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings/broken_batch"))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs of a shell ignore it, and so would ours
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "photos").mkdir()
        expected = write_photos(folder / "photos", given.count)
        table = ["path", *(f"photos/{name}" for name in expected)]
        (folder / "photos.csv").write_text("\n".join(table) + "\n")
        begin = time.monotonic()
        process = start(folder, given.timeout_s)
        journal = folder / "out" / "journal.jsonl"
        interrupt = threading.Timer(60 * given.minutes, process.send_signal, [signal.SIGINT])
        interrupt.start()
        killed = kill_workers(process, journal, expected, given.kill_every)
        interrupt.cancel()
        seconds = time.monotonic() - begin
        interrupted = process.returncode == INTERRUPTED and seconds >= 60 * given.minutes
        found = [f"it ended with {process.returncode}"] if process.returncode and not interrupted else []
        if interrupted and not journal.exists():
            print("0 photos until the interruption", flush=True)
            return 0
        if interrupted:
            names = {Path(row["path"]).name for row in read_rows(folder / "out").values()}
            expected = {name: error for name, error in expected.items() if name in names}
        found += faults_of(folder / "out", expected)
        before = journal.read_bytes()
        if not interrupted and (start(folder, given.timeout_s).wait() or journal.read_bytes() != before):
            found.append("the same command again does not find everything done")
        rows = list(read_rows(folder / "out").values())
        errors = Counter(row["error"] or "done" for row in rows)
        peak = max((row["peak_mb"] for row in rows if row["peak_mb"]), default=0.0)
        print(f"{len(expected)} of {given.count} photos in {seconds:.0f} s, {killed} workers killed, {peak:.0f} MB")
        print(", ".join(f"{number} {name}" for name, number in errors.most_common()), flush=True)
        for fault in found[:20]:
            print(f"FAILED {fault}")
        if found:
            shutil.copytree(folder / "out", given.keep, dirs_exist_ok=True)
            shutil.copy(folder / "output.txt", given.keep)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
