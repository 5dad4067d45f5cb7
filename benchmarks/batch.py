"""What a loaded pipeline and ``physic batch`` save over one ``physic run`` per photo, as ratios of one run.

    python benchmarks/batch.py PHOTOS [--count 200] [--broken 20] [--ways run,pipeline,batch-1,batch-2]

PHOTOS is a folder. Its photos are repeated with flips and crops up to ``--count``, and ``--broken`` files are added
that are not photos. Ways: ``run`` starts ``physic run`` for each photo, ``pipeline`` keeps one ``Pipeline`` loaded in
one process, ``batch-N`` is ``physic batch --workers N``, ``ray-N`` the same on Ray (``contrib/physic-ray``) with N
actors on a cluster that it starts here. None uses the cache. ``run`` has the threads and writes the
pictures that it always does; the others have one thread per process and write ``--save numbers``.

Processor time is that of all processes together and says what a photo costs; the clock says so only on an idle machine.
Ray starts its actors apart from this process: their processor time is not measured.
Memory is that of one process after 10 photos, and at most; of workers the peak.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp")
THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1", "PHYSIC_CACHE": "off"}
LOADED = """
import json, sys
from pathlib import Path
from physic_core import InputError, NoPersonError, Pipeline, save_reconstruction
from physic_core.batch.settings import batch_config
from physic_core.configuration.model import load_config
from physic_core.discovery.plugins import discover

def megabytes():
    pages = int(Path("/proc/self/statm").read_text().split()[1]) if Path("/proc/self/statm").exists() else 0
    return pages * 4096 / 1e6

photos, out, preset = sorted(Path(sys.argv[1]).iterdir()), Path(sys.argv[2]), sys.argv[3]
memory = []
with Pipeline(batch_config(load_config(preset=preset), discover(), cache=False)) as pipeline:
    for photo in photos:
        try:
            found = pipeline(photo)
            save_reconstruction(found, out / photo.stem, "numbers")
        except (InputError, NoPersonError):
            continue
        memory.append(megabytes())
(out / "memory.json").write_text(json.dumps(memory))
"""


@dataclass(frozen=True)
class Cost:
    """Seconds on the clock and of processors, and memory after 10 photos and at the end, MB."""

    clock: float
    processor: float
    early_mb: float = 0.0
    late_mb: float = 0.0


def make_photos(source: Path, folder: Path, count: int, broken: int) -> None:
    """Write ``count`` variants of the photos of a folder, and files that are not photos."""
    from PIL import Image, ImageOps

    found = sorted(path for path in source.rglob("*") if path.suffix.lower() in SUFFIXES)
    for i, path in enumerate(islice(cycle(found), count)):
        image, around = ImageOps.exif_transpose(Image.open(path).convert("RGB")), i // len(found)
        width, height = image.size
        cut = 0.01 * (around // 2)  # the first two rounds are the photo and its mirror image
        image = image.crop((round(cut * width), 0, width - round(cut * width), height - round(cut * height)))
        if around % 2:
            image = ImageOps.mirror(image)
        image.save(folder / f"{i:04}-{path.stem}.jpg", quality=95)
    for i in range(broken):
        (folder / f"broken-{i:04}.jpg").write_bytes(b"\xff\xd8\xff" + bytes(i))


def measure(run: Callable[[], None]) -> Cost:
    """Run and return clock and processor time of the processes that it started."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    run()
    clock, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Cost(clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def start(*words: str, check: bool = True) -> None:
    """Start a program with one thread and without the cache, and wait for its end."""
    subprocess.run(
        words, env={**os.environ, **THREADS}, check=check, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def measure_way(way: str, photos: Path, out: Path, preset: str) -> Cost:
    """Reconstruct all photos in one of the ways."""
    physic = (sys.executable, "-P", "-m", "physic_core")
    out.mkdir()
    if way == "run":

        def loop() -> None:
            for photo in sorted(photos.iterdir()):
                start(
                    *physic,
                    "run",
                    str(photo),
                    "-o",
                    str(out / photo.stem),
                    "--preset",
                    preset,
                    "--no-cache",
                    check=False,
                )

        return measure(loop)
    if way == "pipeline":
        cost = measure(lambda: start(sys.executable, "-P", "-c", LOADED, str(photos), str(out), preset))
        memory = json.loads((out / "memory.json").read_text())
        return Cost(cost.clock, cost.processor, memory[min(9, len(memory) - 1)], max(memory))
    executor, _, workers = way.partition("-")
    words = ("batch", str(photos), "-o", str(out), "--workers", workers, "--preset", preset, "--table", "csv")
    words += ("--executor", "ray") if executor == "ray" else ()
    cost = measure(lambda: start(*physic, *words, "--no-thumbnails"))
    rows = [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]
    memory = [row["peak_mb"] for row in rows if row["peak_mb"]] or [math.nan]
    processor = math.nan if executor == "ray" else cost.processor
    return Cost(cost.clock, processor, memory[min(9, len(memory) - 1)], max(memory))


def main() -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("photos", type=Path)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--broken", type=int, default=20)
    parser.add_argument("--ways", default="run,pipeline,batch-1,batch-2")
    parser.add_argument("--preset", default="embedded")
    given = parser.parse_args()
    print(f"{given.count} photos and {given.broken} broken files, preset {given.preset}\n")
    print("| way | processor s a photo | ratio | clock s a photo | ratio | MB after 10 | MB at most |")
    print("|---|---|---|---|---|---|---|")
    first: Cost | None = None
    with tempfile.TemporaryDirectory() as folder:
        photos = Path(folder, "photos")
        photos.mkdir()
        make_photos(given.photos, photos, given.count, given.broken)
        for way in given.ways.split(","):
            cost = measure_way(way, photos, Path(folder, way), given.preset)
            first = first or cost
            print(
                f"| {way} | {cost.processor / given.count:.1f} | {first.processor / cost.processor:.2f} "
                f"| {cost.clock / given.count:.1f} | {first.clock / cost.clock:.2f} "
                f"| {cost.early_mb:.0f} | {cost.late_mb:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
