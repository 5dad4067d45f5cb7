"""Run a batch of photos of which most break something: ``python tools/attacks/broken_batch.py [--count N]``.

Photos are cut off, empty, bombs, pipes or no pictures; backends return what no interface allows, raise,
hang, end or kill their worker; and workers are killed from outside. The batch must end by itself, its journal must
have one row for each photo with the expected state, and each photo without a fault must have its result. Good photos
are those of ``--photos``, reduced to 400 px, with the mock backends' view of a world; some are replaced while they are
reconstructed. Then results are deleted and cut, rows get a time far ahead, and a folder is locked: the second run must
do exactly those photos again, and rows, files, table and contact sheet must agree.
After ``--minutes`` the batch is interrupted as by Ctrl-C, and the rows until then are compared.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import glob
import io
import itertools
import json
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
from PIL import Image, ImageOps

from faulty import ENDING, FAULTS, FOLDER, HANGING, RAISING, REAL, REPLACED, SETTINGS, as_real, mark, numbered, photo
from fuzzing import photo_bombs
from physic_core.batch.journal import read_rows
from physic_core.errors import InputError
from physic_core.files.document_checksum import with_checksum
from physic_core.io.result_folder import file_digest
from physic_core.io.results import load_reconstruction

WORKERS = 2
INTERRUPTED = 130
"""Exit status after Ctrl-C."""

INPUT_ERROR = 3
"""Exit status after an input that cannot be read."""

EXAMPLES = Path(__file__).parents[2] / "examples"

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


def odd_name(number: int) -> str:
    """Return a name of which every tenth is one that a spreadsheet would compute."""
    starts = ("=cmd|'calc'!A0 ", "@SUM(1) ", "-o ", "+1 ", "\t", "'")
    return f"{starts[number // 10 % len(starts)] if number % 10 == 2 else ''}{number:05d}.png"


def real_photos(folder: Path) -> Iterator[bytes]:
    """Yield the photos of a folder for ever, with a long side of 400 px, which are cut to 4:3 or 3:4."""
    images = []
    for path in sorted(folder.iterdir()):
        with suppress(OSError), Image.open(path) as image:
            image.draft("RGB", (800, 800))
            size = (400, 300) if image.width > image.height else (300, 400)
            images.append(png(as_real(np.asarray(ImageOps.fit(image.convert("RGB"), size)))))
    return itertools.cycle(images or [png(photo())])


def write_photos(
    folder: Path, count: int, real: Iterator[bytes], replacements: Path
) -> tuple[dict[str, str], set[str]]:
    """Write photos; return for each name the class of its error, or "" for a result, and the replaced ones.

    Of ten photos, four are good, three cannot be read, and three have a fault. Each fault occurs in turn, those that
    end a worker or hang, which take long, once in fifty photos. One in twenty is replaced while it is reconstructed.
    """
    good = png(photo())
    broken = itertools.cycle(broken_photos(good).items())
    slow = itertools.cycle([*ENDING, *HANGING])
    done_otherwise = {*RAISING, *ENDING, *HANGING}
    refused = [name for name, (_, error, _) in FAULTS.items() if error and name not in done_otherwise]
    used = [name for name, (_, error, _) in FAULTS.items() if not error and name not in (REAL, REPLACED)]
    faults = itertools.cycle(random.sample(list(RAISING), len(RAISING)) + random.sample(refused, len(refused)))
    deviating = itertools.cycle(random.sample(used, len(used)))
    expected: dict[str, str] = {}
    replaced = set()
    for number in range(count):
        name = odd_name(number)
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
            path.write_bytes(next(real))
            expected[name] = ""
            if number % 20 == 8:
                path.write_bytes(png(numbered(photo(), number)))
                (replacements / f"{number}.png").write_bytes(next(real))
                (replacements / f"{number}.txt").write_text(str(path))
                replaced.add(name)
    return expected, replaced


def write_other_files(folder: Path) -> str:
    """Write files that are no photos; return what the command says of them."""
    (folder / "notes.txt").write_text("no photo")
    (folder / ".hidden.jpg").write_bytes(png(photo()))
    result = folder / "earlier"
    result.mkdir()
    for name in ("reconstruction.json", "preview.png"):
        (result / name).write_bytes(png(photo()))
    return "skipped 4 files: 2 in folders of results, 1 .txt, 1 hidden"


def start(folder: Path, timeout_s: float, *more: str) -> subprocess.Popen[bytes]:
    environment = os.environ | {"PHYSIC_CACHE": "off", "PYTHONPATH": _path(), "OMP_NUM_THREADS": "1"}
    environment[FOLDER] = str(folder / "replacements")
    words = ["batch", "photos", "-o", "out", "--preset", "mock", "--workers", str(WORKERS), "--table", "csv", *more]
    words += itertools.chain.from_iterable(("--set", text) for text in (*SETTINGS, f"run.timeout_s={timeout_s:g}"))
    with (folder / "output.txt").open("ab") as output:
        return subprocess.Popen(
            (*PHYSIC, *words), cwd=folder, env=environment, stdout=output, stderr=output, preexec_fn=_without_privilege
        )


def _without_privilege() -> None:
    """Let root of Linux read only what its permissions allow, in the program that is started next."""
    if sys.platform == "linux" and os.geteuid() == 0:
        for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH
            ctypes.CDLL(None).prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


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


def faults_of(out: Path, expected: dict[str, str], lines: int | None = None) -> Iterator[str]:
    """Yield what is wrong with the journal and the results; ``lines`` is the number of lines, one a photo if None."""
    rows = {Path(row["path"]).name: row for row in read_rows(out).values()}
    found = (out / "journal.jsonl").read_bytes().count(b"\n")
    if set(rows) != set(expected) or found != (lines or len(expected)):
        yield f"{len(rows)} photos in {found} lines of the journal, and {len(expected)} photos"
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


def damage(out: Path, replaced: set[str]) -> set[str]:
    """Delete or cut files of results and thumbnails, and set clocks ahead; return the photos to be done again."""
    rows = [row for row in read_rows(out).values() if row["state"] == "done"]
    again = set()
    for number, row in enumerate(rows):
        if Path(row["path"]).name in replaced or number % 4:
            continue
        lost = ("reconstruction.json", "reconstruction.npz", "")[number // 4 % 3]
        (thumbnail,) = out.glob(f"thumbnails/*/{glob.escape(Path(row['folder']).name)}.jpg")
        path = out / row["folder"] / lost if lost else thumbnail
        content = path.read_bytes()
        path.unlink()
        if number // 12 % 2:
            path.write_bytes(content[: len(content) // 2])
        if lost:
            again.add(Path(row["path"]).name)
    lines = [json.loads(line) for line in (out / "journal.jsonl").read_bytes().splitlines()]
    for number, row in enumerate(lines):
        if number % 2:
            row |= {"finished": "2999-01-01T00:00:00.000+00:00"}
    (out / "journal.jsonl").write_text("".join(json.dumps(with_checksum(row)) + "\n" for row in lines))
    return again


def disagreements(out: Path, photos: Path, again: set[str]) -> Iterator[str]:
    """Yield where rows, files, table and contact sheet differ; ``again`` are photos that were done in a second run."""
    rows = read_rows(out)
    with (out / "summary.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    if computed := [text for row in table for text in row.values() if text.startswith(tuple("=+-@\t\r"))]:
        yield f"the table has {len(computed)} formulas, such as {computed[0]!r}"
    listed = {row["id"].removeprefix("'"): row for row in table}
    if listed.keys() != rows.keys() or len(table) != len(rows):
        yield f"the table has {len(table)} rows, the journal {len(rows)}"
    page = (out / "contact-sheet.html").read_text(encoding="utf-8")
    cards = {
        card["name"]: card
        for card in json.loads(page.partition('id="data" type="application/json">')[2].partition("<")[0])
    }
    if cards.keys() != rows.keys():
        yield f"the contact sheet has {len(cards)} photos, the journal {len(rows)}"
    if str(out.parent) in page:
        yield "the contact sheet names a folder of this machine"
    for name, row in rows.items():
        path = Path(row["path"])
        for column in ("state", "error", "photo", "finished"):
            if listed[name][column] != row[column]:
                yield f"{path.name}: the table has the {column} {listed[name][column]!r}, the journal {row[column]!r}"
        if (cards[name]["state"], cards[name]["title"]) != (row["state"], path.name):
            yield f"{path.name}: its card has {cards[name]['state']} {cards[name]['title']!r}"
        if row["state"] == "done":
            sizes = dict(text.split("=") for text in row["files"].split())
            thumbnail = sizes.pop("thumbnail")
            if any((out / row["folder"] / file).stat().st_size != int(size) for file, size in sizes.items()):
                yield f"{path.name}: its files have not the sizes {row['files']}"
            if not cards[name]["thumbnail"] or int(thumbnail) <= 0:
                yield f"{path.name}: no thumbnail"
        if path.is_file() and (row["photo"], row["bytes"]) != (file_digest(path), path.stat().st_size):
            yield f"{path.name}: its row is of another file"
        if (path.name in again) != (row["run"] == 2):
            yield f"{path.name}: its row is of run {row['run']}"
        if path.name in again and row["finished"].startswith("2999"):
            yield f"{path.name}: a clock has decided which row counts"


def unreadable(folder: Path, timeout_s: float) -> Iterator[str]:
    """Yield what is wrong if a sub-folder of the photos cannot be read."""
    locked, journal = folder / "photos" / "locked", folder / "out" / "journal.jsonl"
    locked.mkdir(mode=0)
    before = journal.read_bytes()
    if start(folder, timeout_s).wait() != INPUT_ERROR or journal.read_bytes() != before:
        yield "a folder that cannot be read is no error"
    if "cannot read the folder photos/locked: Permission denied" not in (folder / "output.txt").read_text():
        yield "the message about a folder that cannot be read is missing"
    locked.rmdir()


def second_run(folder: Path, timeout_s: float, expected: dict[str, str], replaced: set[str]) -> Iterator[str]:
    """Damage results, run the same command again, and yield what is wrong with rows, files, table and page."""
    out = folder / "out"
    again = damage(out, replaced) | replaced
    yield from unreadable(folder, timeout_s)
    if start(folder, timeout_s).wait():
        yield "the second run ended with an error"
    yield from faults_of(out, expected, len(expected) + len(again))
    yield from disagreements(out, folder / "photos", again)
    before = (out / "journal.jsonl").read_bytes()
    if start(folder, timeout_s, "--verify").wait() or (out / "journal.jsonl").read_bytes() != before:
        yield "the third run does not find everything done"
    print(f"second run: {len(again)} photos done again, of which {len(replaced)} were replaced", flush=True)


def main() -> int:
    """Run the batch; return 1 if a row or a result is missing or wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=100, help="photos")
    parser.add_argument("--minutes", type=float, default=60, help="interrupt the batch after so long")
    parser.add_argument("--timeout-s", type=float, default=20, help="limit of a call of a backend")
    parser.add_argument("--kill-every", type=float, default=60, metavar="S", help="kill a worker about every S seconds")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings/broken_batch"))
    parser.add_argument("--photos", type=Path, default=EXAMPLES, help="folder of photos of cameras")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs of a shell ignore it, and so would ours
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "photos").mkdir()
        (folder / "replacements").mkdir()
        expected, replaced = write_photos(
            folder / "photos", given.count, real_photos(given.photos), folder / "replacements"
        )
        skipped = write_other_files(folder / "photos")
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
        if skipped not in (folder / "output.txt").read_text():
            found.append(f"the command does not say: {skipped}")
        found += faults_of(folder / "out", expected)
        if not interrupted:
            found += second_run(folder, given.timeout_s, expected, replaced)
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
