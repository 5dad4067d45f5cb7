"""Remove each defence in turn, and require that its test fails: ``python tools/mutants.py [NAME
...]``.

The folder ``tools/attacks/mutants`` has a patch for each defence, with the test. Patches are
applied to a copy of the tracked and new files of this checkout. All tests must pass there before. A
patch that does not apply, and a test that does not run, are failures too.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "tools" / "attacks" / "mutants"
# exit codes of pytest
PASSED = 0
FAILED = 1


@dataclass(frozen=True)
class Mutant:
    """A defence that can be removed.

    Attributes:
        name: of the patch, without suffix.
        patch: the file.
        test: as pytest takes it, relative to the checkout.
    """

    name: str
    patch: Path
    test: str


def read_mutants(names: Sequence[str]) -> list[Mutant]:
    """Return the mutants of these names, or all; exit with a message if one does not exist or names
    no test.
    """
    patches = {path.stem: path for path in sorted(FOLDER.glob("*.patch"))}
    if unknown := [name for name in names if name not in patches]:
        sys.exit(f"no patch is named {', '.join(unknown)}: {', '.join(patches)}")
    mutants = []
    for name in names or patches:
        line = patches[name].read_text(encoding="utf-8").partition("\n")[0]
        if not line.startswith("Test: "):
            sys.exit(
                f'{patches[name]}: the first line must be "Test: " and the test that must fail'
            )
        mutants.append(Mutant(name, patches[name], line.removeprefix("Test: ").strip()))
    return mutants


def copy_checkout(target: Path) -> None:
    """Copy the files that git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in listed.split("\0"):
        if name and (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, target / name)


def run_tests(copy: Path, tests: Sequence[str]) -> tuple[int, str]:
    """Run tests in the copy, which hides the checkout that is installed here; return pytest's exit
    code and its output.
    """
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    roots = [copy, *(path.parent for path in sorted(copy.glob("*/*/pyproject.toml")))]
    environment = os.environ | {
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join(map(str, roots)),
    }
    done = subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout + done.stderr


def apply(copy: Path, mutant: Mutant, *options: str) -> str:
    """Apply a patch to the copy; return git's message, "" if it applies."""
    command = ["git", "apply", "-C1", "--whitespace=nowarn", *options, str(mutant.patch)]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False)
    return done.stderr.strip() if done.returncode else ""


def fault(copy: Path, mutant: Mutant) -> str:
    """Remove a defence, run its test, and bring it back; return what is wrong, "" if the test
    noticed.
    """
    if message := apply(copy, mutant):
        return f"the patch does not apply any more: make it again ({message})"
    code, output = run_tests(copy, [mutant.test])
    if message := apply(copy, mutant, "--reverse"):
        sys.exit(f"{mutant.name}: {message}")
    if code == PASSED:
        return f"not noticed: {mutant.test} passes without this defence"
    return (
        ""
        if code == FAILED
        else f"the test does not run (pytest ended with {code}):\n{output[-2000:]}"
    )


def main() -> int:
    """Return 1 if the removal of a defence was not noticed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    mutants = read_mutants(parser.parse_args().names)
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder).resolve() / "copy"
        copy_checkout(copy)
        code, output = run_tests(copy, sorted({mutant.test for mutant in mutants}))
        if code != PASSED:
            sys.exit(f"the tests must pass before a defence is removed:\n{output[-4000:]}")
        for mutant in mutants:
            failure = fault(copy, mutant)
            bad += bool(failure)
            print(f"{mutant.name}: {failure or 'noticed'}", flush=True)
    print(f"{len(mutants) - bad} of {len(mutants)} removed defences were noticed")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
