"""What ``physic batch`` leaves behind after faults, and its memory over many photos, with mock backends.

    python benchmarks/batch_faults.py [--faults photos,worker,parent,disk,memory] [--photos 12] [--memory-photos 1000]

Each fault is a batch of its own, and the same command is given again until it does nothing more:

- ``photos``: one photo is broken, on one a backend hangs, on one it aborts its process, on one it raises;
- ``worker``: a worker process is killed by SIGKILL in the middle;
- ``parent``: the batch itself is killed by SIGKILL in the middle;
- ``disk``: the output folder is on a file system that gets full, and is then emptied of what filled it (Linux, root);
- ``memory``: the memory of one worker after 10 photos and at the end.

A row of the table counts photos and rows of the journal, and names what is wrong: photos without a row or finished
twice, results that cannot be loaded, and files without a row.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faulty_mock import image_digest

from physic_core import load_reconstruction
from physic_testing.worlds import build_world

SIZE = (160, 120)
WORLDS = ("stand", "walk", "lean_on_wall", "squat")
TIMEOUT_S = 60
FREE_MB = 2  # on the small disk, beside what fills it; results of a photo take 0.5 MB


@dataclass(frozen=True)
class Batch:
    """A folder of photos, a configuration and an output folder."""

    photos: Path
    config: Path
    out: Path
    workers: int = 2

    @property
    def command(self) -> list[str]:
        """Return the command; photos that failed are not tried again."""
        out = ["-o", str(self.out), "--table", "csv", "--no-thumbnails", "--timeout", str(TIMEOUT_S)]
        physic = [sys.executable, "-P", "-m", "physic_core", "batch", str(self.photos)]
        return [*physic, *out, "--config", str(self.config), "--workers", str(self.workers)]

    def start(self) -> subprocess.Popen[bytes]:
        """Start the batch."""
        log = self.out.parent / f"{self.out.name}.log"
        with log.open("ab") as file:
            return subprocess.Popen(self.command, stdout=file, stderr=file)

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of the journal; a line that was cut off is none."""
        journal = self.out / "journal.jsonl"
        rows = []
        for line in journal.read_text(errors="replace").splitlines() if journal.exists() else ():
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                continue
        return rows

    def wait_for_rows(self, count: int, process: subprocess.Popen[bytes]) -> None:
        """Wait until the journal has so many rows, or the process ends."""
        while len(self.rows()) < count and process.poll() is None:
            time.sleep(0.1)


def make_photos(folder: Path, count: int) -> None:
    """Write photos of synthetic worlds, which the mock backends know; several show the same world."""
    from PIL import Image

    folder.mkdir()
    for i in range(count):
        name = WORLDS[i % len(WORLDS)]
        Image.fromarray(build_world(name, 0, SIZE).image).save(folder / f"{i:04}-{name}.png")


def make_faulty_photos(folder: Path) -> dict[str, str]:
    """Write a broken photo and three on which the segmenter fails; return the digests of these by option."""
    from PIL import Image

    (folder / "broken.jpg").write_bytes(b"\xff\xd8\xff")
    digests = {}
    for seed, kind in enumerate(("hang", "abort", "fail"), start=1):
        image = build_world("stand", seed, SIZE).image
        Image.fromarray(image).save(folder / f"{kind}.png")
        digests[kind] = image_digest(image)
    return digests


def write_config(folder: Path, digests: dict[str, str]) -> Path:
    """Write a configuration of mocks with the segmenter of ``faulty_mock``."""
    shutil.copy(Path(__file__).with_name("faulty_mock.py"), folder)
    options = "".join(f'{kind} = ["{digest}"]\n' for kind, digest in digests.items())
    text = 'extends = "mock"\n\n[segmenter]\nbackend = "faulty_mock:FaultySegmenter"\n'
    path = folder / "faulty.toml"
    path.write_text(f"{text}\n[segmenter.options]\n{options}" if options else text)
    return path


def run_to_end(batch: Batch, runs: int = 5) -> int:
    """Give the command until it does nothing more; return how often it did something."""
    for done in range(runs):
        before = len(batch.rows())
        batch.start().wait()
        if len(batch.rows()) == before:
            return done
    raise AssertionError(f"the batch does not come to an end in {runs} runs")


def child_processes(parent: int) -> list[int]:
    """Return the worker processes of a batch (Linux)."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
            words = (status.parent / "cmdline").read_text()
        except OSError:
            continue
        if int(fields[1]) == parent and "spawn_main" in words:
            found.append(int(status.parent.name))
    return sorted(found)


def kill_worker(batch: Batch) -> None:
    """Run the batch, and kill one of its workers after two rows."""
    process = batch.start()
    batch.wait_for_rows(2, process)
    for worker in child_processes(process.pid)[:1]:
        os.kill(worker, signal.SIGKILL)
    process.wait()


def kill_parent(batch: Batch) -> None:
    """Run the batch, and kill it after two rows; its workers must end too."""
    process = batch.start()
    batch.wait_for_rows(2, process)
    workers = child_processes(process.pid)
    process.kill()
    process.wait()
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        if time.monotonic() > deadline:
            raise AssertionError(f"workers {workers} still run 30 s after their batch was killed")
        time.sleep(0.2)


def fill_disk(batch: Batch) -> None:
    """Run the batch on a small file system until that is full, then free what else was on it."""
    filler = batch.out / "filler"
    free = shutil.disk_usage(batch.out).free
    filler.write_bytes(bytes(free - (FREE_MB << 20)))
    process = batch.start()
    process.wait()
    if process.returncode == 0:
        raise AssertionError("the disk did not get full")
    filler.unlink()


def problems_of(batch: Batch) -> list[str]:
    """Return what is wrong with the rows and files of a batch that has come to its end."""
    rows = batch.rows()
    last = {row["id"]: row for row in rows}
    photos = {str(path.resolve()) for path in batch.photos.iterdir()}
    found = [f"no row: {Path(name).name}" for name in sorted(photos - {row["path"] for row in rows})]
    finished = Counter(row["id"] for row in rows if row["state"] == "done")
    found += [f"finished {count} times: {name}" for name, count in finished.items() if count > 1]
    folders = {row["folder"] for row in last.values() if row["state"] == "done"}
    for folder in sorted(folders):
        try:
            load_reconstruction(batch.out / folder)
        except Exception as error:
            found.append(f"cannot be loaded: {folder}: {error}")
    for path in sorted((batch.out / "photos").glob("*/*")):
        if path.relative_to(batch.out).as_posix() not in folders:
            found.append(f"no row: files {path.relative_to(batch.out)}")
    return found


def measure_memory(batch: Batch) -> str:
    """Return the peak memory of the worker after 10 photos and at the end."""
    batch.start().wait()
    peaks = [row["peak_mb"] for row in batch.rows() if row["peak_mb"]]
    return f"peak of the worker: {peaks[min(9, len(peaks) - 1)]:.0f} MB after 10 photos, {peaks[-1]:.0f} MB at the end"


FAULTS: dict[str, Callable[[Batch], object]] = {
    "photos": lambda batch: batch.start().wait(),
    "worker": kill_worker,
    "parent": kill_parent,
    "disk": fill_disk,
    "memory": measure_memory,
}


def run_fault(name: str, folder: Path, count: int) -> None:
    """Run a batch with a fault, resume it, and print a row of the table."""
    folder.mkdir()
    photos, out = folder / "photos", folder / "out"
    make_photos(photos, count)
    digests = make_faulty_photos(photos) if name == "photos" else {}
    batch = Batch(photos, write_config(folder, digests), out, workers=1 if name == "memory" else 2)
    out.mkdir()
    if name == "disk":
        size = f"size={FREE_MB + count}m"
        subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(out)], check=True)
    try:
        said = FAULTS[name](batch)
        first = len(batch.rows())
        runs = run_to_end(batch)
        states = Counter(row["error"] or "done" for row in {row["id"]: row for row in batch.rows()}.values())
        described = ", ".join(f"{count} {state}" for state, count in states.items())
        found = [*problems_of(batch), *([said] if isinstance(said, str) else [])]
        print(
            f"| {name} | {len(list(photos.iterdir()))} | {first} | {runs} | {described} | {'; '.join(found) or '-'} |"
        )
    finally:
        if name == "disk":
            subprocess.run(["umount", str(out)], check=True)


def main() -> None:
    """Run the faults and print a Markdown table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--faults", default="photos,worker,parent,disk,memory")
    parser.add_argument("--photos", type=int, default=12)
    parser.add_argument("--memory-photos", type=int, default=1000)
    given = parser.parse_args()
    print("| fault | photos | rows after it | runs that did the rest | rows at the end | what is wrong |")
    print("|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in given.faults.split(","):
            count = given.memory_photos if name == "memory" else given.photos
            run_fault(name, Path(folder, name), count)


if __name__ == "__main__":
    main()
