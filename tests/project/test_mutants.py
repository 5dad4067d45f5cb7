"""The patches of ``make mutants``: each can be applied, and names a test that exists."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATCHES = sorted((ROOT / "tools" / "attacks" / "mutants").glob("*.patch"))


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
@pytest.mark.parametrize("patch", PATCHES, ids=lambda path: path.stem)
def test_a_patch_applies_and_its_test_exists(patch):
    command = ["git", "apply", "--check", "-C1", str(patch)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"make the patch again: {done.stderr}"
    named = re.match(r"Test: ([\w./-]+\.py)(?:::(\w+))?", patch.read_text(encoding="utf-8"))
    assert named is not None
    assert f"def {named[2] or 'test_'}" in (ROOT / named[1]).read_text(encoding="utf-8")
