"""Kill processes that save at random moments, and save from many at once: ``python tools/attacks/kill_saves.py``.

A process saves one result after another to one folder. It is killed (SIGKILL) after a random time; then the folder must
hold one of these results completely, and the next process goes on. At the end, many processes save to one folder and
one cache at the same time, while this one reads.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import physic_core.io.results as results
from fuzzing.tiny_result import difference, tiny_result
from physic_core.errors import InputError
from physic_core.files.archive import DamagedFileError, read_archive, write_archive
from physic_core.io.results import load_reconstruction, save_reconstruction
from physic_core.types import Reconstruction

RESULTS = 4
FILES = {"reconstruction.json", "reconstruction.npz", "preview.png", "scene.glb", "combined.glb"}


def pictures(result: Reconstruction, *, preview: bool, glb: bool) -> tuple[dict[str, bytes], None]:
    """Pictures that name their result, of the size of rendered ones, in place of the time to render them."""
    names = ("scene.glb", "combined.glb", "person_0.glb", "person_1.glb", "preview.png")
    return {name: 20_000 * f"{seed_of(result)} ".encode() for name in names}, None


def seed_of(result: Reconstruction) -> int:
    seed: int = result.diagnostics["joint"]["seed"]
    return seed


def save_for_ever(folder: str, compact: bool) -> None:
    results._pictures = pictures
    made = [tiny_result(seed) for seed in range(RESULTS)]
    while True:
        save_reconstruction(random.choice(made), folder, compact=compact, preview=not compact, glb=not compact)


def save_often(folder: str, cache: str, number: int, times: int) -> None:
    results._pictures = pictures
    for _ in range(times):
        result = tiny_result(random.randrange(RESULTS))
        save_reconstruction(result, folder)
        write_archive(Path(cache, f"{random.randrange(4)}.answer.npz"), {"image": result.image}, {"process": number})


def fault_of(folder: Path, compact: bool) -> str:
    """Return what is wrong with the result in a folder; "" if it is one of those that were saved."""
    try:
        loaded = load_reconstruction(folder)
    except InputError as error:
        return str(error)
    seed = seed_of(loaded)
    if not compact and (where := difference(tiny_result(seed), loaded)):
        return f"{where} differs from result {seed}"
    marks = {path.read_bytes().split()[0] for path in folder.glob("[!.]*") if path.suffix in (".glb", ".png")}
    return f"pictures of {marks} beside result {seed}" if len(marks) > 1 else ""


def kill_once(folder: Path, compact: bool, least: float, most: float) -> str:
    """Kill a process that saves after a random time; return what was wrong with its end."""
    process = multiprocessing.get_context("fork").Process(target=save_for_ever, args=(str(folder), compact))
    process.start()
    time.sleep(random.uniform(least, most))
    process.kill()
    process.join()
    return "" if process.exitcode == -signal.SIGKILL else f"it ended with {process.exitcode} by itself"


def read_while_saved(folder: Path, cache: Path, is_running: Callable[[], bool]) -> tuple[int, list[str]]:
    """Read result and cache until the processes have ended; return how often, and what was wrong."""
    count, faults = 0, []
    while is_running():
        count += 1
        if (folder / "reconstruction.json").exists() and (fault := fault_of_load(folder)):
            faults.append(fault)
        for path in cache.glob("[!.]*"):
            try:
                read_archive(path)
            except DamagedFileError as error:
                faults.append(f"{path.name}: {error}")
    return count, faults


def fault_of_load(folder: Path) -> str:
    try:
        loaded = load_reconstruction(folder)
    except InputError as error:
        return str(error)
    return difference(tiny_result(seed_of(loaded)), loaded)


def main() -> int:
    """Kill and save; return 1 if a result was incomplete."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--processes", type=int, default=16)
    parser.add_argument("--saves", type=int, default=20, help="of each of these processes")
    parser.add_argument("--minutes", type=float, default=1e6, help="end after about this time")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings/kill_saves"))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random.seed(given.seed)
    begin = time.monotonic()
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as temporary:
        for part, compact in enumerate((False, True), start=1):
            folder = Path(temporary, f"killed-{compact}")
            save_often_once(folder, compact)
            number = 0
            while number < given.kills // 2 and time.monotonic() - begin < 60 * given.minutes * part / 3:
                ended = kill_once(folder, compact, 0.0, 0.3)
                number += 1
                if fault := ended or fault_of(folder, compact):
                    faults.append(f"kill {number}: {fault}")
                    shutil.copytree(folder, given.keep / f"{compact}-{number}", dirs_exist_ok=True)
                    shutil.rmtree(folder)
                    save_often_once(folder, compact)
            save_often_once(folder, compact)
            if left := [path.name for path in folder.glob(".*")]:
                faults.append(f"left behind: {left}")
            print(f"{number} kills{' of compact saves' * compact}: {len(faults)} incomplete", flush=True)
        folder, cache = Path(temporary, "many"), Path(temporary, "cache")
        cache.mkdir()
        context = multiprocessing.get_context("fork")
        tasks = [(str(folder), str(cache), number, given.saves) for number in range(given.processes)]
        processes = [context.Process(target=save_often, args=task) for task in tasks]
        for process in processes:
            process.start()
        count, found = read_while_saved(folder, cache, lambda: any(p.is_alive() for p in processes))
        found += [f"a process ended with {process.exitcode}" for process in processes if process.exitcode]
        found += [fault] if (fault := fault_of(folder, False)) else []
        found += [f"left behind: {path.name}" for path in (*folder.glob(".*"), *cache.glob(".*"))]
        total = given.processes * given.saves
        print(f"{total} saves by {given.processes} processes, read {count} times: {len(found)} faults", flush=True)
        faults += found
    for fault in faults[:20]:
        print(fault)
    return 1 if faults else 0


def save_often_once(folder: Path, compact: bool) -> None:
    results._pictures, kept = pictures, results._pictures
    save_reconstruction(tiny_result(0), folder, compact=compact, preview=not compact, glb=not compact)
    results._pictures = kept


if __name__ == "__main__":
    sys.exit(main())
