"""Remove each defence in turn, and require that its test fails: ``python tools/mutants.py [NAME
...]``.

The folder ``tools/attacks/mutants`` has a patch for each defence, with the test. Patches are
applied to a copy of the tracked and new files of this checkout. All tests must pass there before. A
patch that does not apply, and a test that does not run, are failures too.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "tools" / "attacks" / "mutants"


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


def apply(copy: Path, patch: Path, *options: str) -> str:
    """Apply a patch to the copy; return git's message, "" if it applies."""
    command = ["git", "apply", "-C1", "--whitespace=nowarn", *options, str(patch)]
    done = subprocess.run(command, cwd=copy, capture_output=True, text=True, check=False)
    return done.stderr.strip() if done.returncode else ""


def fault(copy: Path, patch: Path) -> str:
    """Remove a defence, run its test, and bring it back; return what is wrong, "" if the test
    noticed.
    """
    if message := apply(copy, patch):
        return f"the patch does not apply any more: make it again ({message})"
    code, output = run_tests(copy, [test_of(patch)])
    if message := apply(copy, patch, "--reverse"):
        sys.exit(f"{patch.stem}: {message}")
    return "" if code == pytest.ExitCode.TESTS_FAILED else f"not noticed:\n{output[-2000:]}"


def test_of(patch: Path) -> str:
    """Return the test that a patch names in its first line."""
    line = patch.read_text(encoding="utf-8").partition("\n")[0]
    return line.removeprefix("Test: ").strip()


def main() -> int:
    """Return 1 if the removal of a defence was not noticed."""
    patches = [FOLDER / f"{name}.patch" for name in sys.argv[1:]] or sorted(FOLDER.glob("*.patch"))
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder).resolve() / "copy"
        copy_checkout(copy)
        code, output = run_tests(copy, sorted({test_of(patch) for patch in patches}))
        if code:
            sys.exit(f"the tests must pass before a defence is removed:\n{output[-4000:]}")
        for patch in patches:
            failure = fault(copy, patch)
            bad += bool(failure)
            print(f"{patch.stem}: {failure or 'noticed'}", flush=True)
    print(f"{len(patches) - bad} of {len(patches)} removed defences were noticed")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
