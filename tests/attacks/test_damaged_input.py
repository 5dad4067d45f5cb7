"""Damaged and hostile input: every reader refuses it with its own error, or reads what was written."""

from __future__ import annotations

from pathlib import Path

import pytest

from fuzzing.target import Target
from fuzzing.targets import all_targets

CASES = 100
"""Of each target; ``make fuzz`` goes on from there."""


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
            error.add_note(f"python tools/attacks/fuzz.py {target.name} --case {case}")
            raise


@pytest.mark.parametrize(
    ("target", "file"),
    [
        pytest.param(target, file, id=f"{target.name}-{file.name}")
        for target in all_targets()
        for file in target.corpus()
    ],
)
def test_files_that_once_broke_a_reader_are_read_or_refused(target: Target, file: Path, tmp_path: Path):
    target.attack(file.read_bytes(), tmp_path)
