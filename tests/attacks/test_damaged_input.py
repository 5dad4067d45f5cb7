"""Damaged and hostile input: every reader refuses it with its own error, or reads what was
written.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from fuzzing.target import Target
from fuzzing.targets import all_targets

CASES = int(os.environ.get("ATTACK_CASES", "100"))
"""Of each target; ``make fuzz`` takes more."""


@pytest.mark.parametrize("target", all_targets(), ids=lambda target: target.name)
def test_undamaged_files_are_read(target: Target, tmp_path: Path):
    seeds = target.make_seeds(tmp_path / "seeds")
    assert seeds
    for i, seed in enumerate(seeds):
        (tmp_path / str(i)).mkdir()
        target.attack(seed, tmp_path / str(i))


@pytest.mark.parametrize("target", all_targets(), ids=lambda target: target.name)
def test_damaged_files_are_read_or_refused(target: Target, tmp_path: Path):
    for case, data in target.mutated(tmp_path / "seeds", 0, CASES):
        folder = tmp_path / str(case)
        folder.mkdir()
        try:
            target.attack(data, folder)
        except Exception as error:
            error.add_note(f"case {case} of {target.name}, seed 0")
            raise


@pytest.mark.parametrize(
    ("target", "file"),
    [
        pytest.param(target, file, id=f"{target.name}-{file.name}")
        for target in all_targets()
        for file in target.corpus()
    ],
)
def test_files_that_once_broke_a_reader_are_read_or_refused(
    target: Target, file: Path, tmp_path: Path
):
    target.attack(file.read_bytes(), tmp_path)
