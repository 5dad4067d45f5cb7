"""Attack readers of files for as long as you like: ``python tools/attacks/fuzz.py [TARGET ...] [--minutes 10]``.

Each target, or all without TARGET, gets its share of the time, in a process of its own with 8 GB of address space at
most. With ``atheris`` installed, coverage guides the mutations; without it they are random, seeded by ``--seed``. An
input that fails is written to ``--keep`` with its traceback beside it; after the fix, move it to ``corpus/TARGET/``.
``--case N`` runs one case of the tests again.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from itertools import count
from pathlib import Path
from types import FunctionType

from fuzzing.target import Target
from fuzzing.targets import all_targets

ADDRESS_SPACE = 8 << 30
READERS = ("physic_core", "PIL", "pydantic", "numpy.lib", "zipfile", "tarfile", "json", "tomllib", "pickle", "csv")


def attack_once(target: Target, data: bytes, keep: Path) -> bool:
    """Attack in a fresh folder; keep the input and the traceback if it fails, and return whether it passed."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            target.attack(data, Path(folder))
        except Exception:
            path = keep / target.name / hashlib.sha256(data).hexdigest()[:16]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
            path.with_suffix(".txt").write_text(traceback.format_exc())
            return False
    return True


def attack_for(target: Target, seconds: float, seed: int, keep: Path) -> tuple[int, int]:
    """Attack with random mutations; return how many inputs ran and how many failed."""
    end, ran, failed = time.monotonic() + seconds, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for round_ in count():
            for _, data in target.mutated(Path(folder, str(round_)), seed + 1000 * round_, 1000):
                if time.monotonic() > end:
                    return ran, failed
                ran += 1
                failed += not attack_once(target, data, keep)
    raise AssertionError


def attack_guided(target: Target, seconds: float, keep: Path) -> None:
    """Let atheris mutate; it ends the process."""
    import atheris

    with tempfile.TemporaryDirectory() as folder:
        seeds = Path(folder, "corpus")
        seeds.mkdir()
        inputs = [*target.make_seeds(Path(folder, "seeds")), *(path.read_bytes() for path in target.corpus())]
        for i, data in enumerate(inputs):
            (seeds / str(i)).write_bytes(data)
        for function in _functions_of_readers():
            atheris.instrument_func(function)
        # An input that fails is kept and does not end the attack.
        flags = [f"-max_total_time={round(seconds)}", "-timeout=60", "-rss_limit_mb=6000", "-print_final_stats=1"]

        def attack(data: bytes) -> None:
            attack_once(target, data, keep)

        atheris.Setup([sys.argv[0], *flags, str(seeds)], attack)
        atheris.Fuzz()


def _functions_of_readers() -> list[FunctionType]:
    """Return the loaded Python functions of readers and of the libraries under them: of all loaded, these guide."""
    return [
        one
        for one in gc.get_objects()
        if isinstance(one, FunctionType) and str(one.__module__).startswith(READERS) and one.__module__ in sys.modules
    ]


def main() -> int:
    """Run targets one after another; return 1 if something failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("targets", nargs="*", metavar="TARGET")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seed", type=int, default=1_000_000)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"))
    parser.add_argument("--random", action="store_true", help="random mutations, even with atheris installed")
    parser.add_argument("--case", type=int, help="run this case of the tests again, in this process")
    parser.add_argument("--one", type=float, metavar="SECONDS", help=argparse.SUPPRESS)
    given = parser.parse_args()
    chosen = [target for target in all_targets() if not given.targets or target.name in given.targets]
    if unknown := set(given.targets) - {target.name for target in chosen}:
        parser.error(f"no target named {', '.join(sorted(unknown))}: {', '.join(t.name for t in all_targets())}")
    if given.case is not None and len(chosen) == 1:
        with tempfile.TemporaryDirectory() as folder:
            [(_, data)] = chosen[0].mutated(Path(folder, "seeds"), given.case, 1)
            chosen[0].attack(data, Path(folder))
        return 0
    if given.one is not None:
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        if given.random or not chosen[0].guided:
            ran, failed = attack_for(chosen[0], given.one, given.seed, given.keep)
            print(f"{chosen[0].name}: {ran} inputs, {failed} failed", flush=True)
            return 0
        attack_guided(chosen[0], given.one, given.keep)
        return 0
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("atheris is not installed: mutations are random", flush=True)
        given.random = True
    bad = []
    for target in chosen:
        words = [target.name, "--one", str(60 * given.minutes / len(chosen)), "--seed", str(given.seed)]
        words += ["--keep", str(given.keep)] + (["--random"] if given.random else [])
        ended = subprocess.run([sys.executable, __file__, *words], check=False).returncode
        kept = list((given.keep / target.name).glob("*.txt"))
        if ended or kept:
            bad.append(target.name)
        print(f"{target.name}: {len(kept)} inputs failed, the process ended with {ended}", flush=True)
    print("failed: " + ", ".join(bad) if bad else "nothing failed", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
