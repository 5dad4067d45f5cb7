"""A second call of ``physic evaluate`` scores what is missing or changed, and the tables name the options."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physic_bench.joints import LIMB_JOINTS

from .miniatures import TRUE, run, write_measured_photos, write_plain


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Three photos with one measured person each, and results 2 cm off."""
    for i in range(3):
        write_plain(tmp_path / "theirs", f"p{i}", joints=TRUE[None] + [0.02, 0, 0], joint_names=np.array(LIMB_JOINTS))
    return write_measured_photos(tmp_path / "mine")


def call(root: Path, *more: str) -> str:
    """Run the command, and return what it printed."""
    out = root.parent / "out"
    done = run("calibrated", str(root), "-o", str(out), "--results", f"theirs=plain:{root.parent / 'theirs'}", *more)
    assert done.exit_code == 0, done.output
    return done.output


def unchanged(count: int, total: int = 3) -> str:
    return f"{count} of {total} scores unchanged, from scores/journal.jsonl\n"


def document(root: Path) -> dict:
    return json.loads((root.parent / "out" / "results.json").read_text())


def test_the_same_call_scores_nothing_and_gives_the_same(root: Path):
    assert "unchanged" not in call(root)
    first = {path.name: path.read_bytes() for path in (root.parent / "out").glob("*.*") if path.suffix != ".png"}
    journal = root.parent / "out" / "scores" / "journal.jsonl"
    lines = journal.read_bytes()
    assert unchanged(3) in call(root)
    assert journal.read_bytes() == lines
    for name, content in first.items():
        assert (root.parent / "out" / name).read_bytes() == content, name


def test_only_changed_results_are_scored_again(root: Path):
    call(root)
    write_plain(root.parent / "theirs", "p1", joints=TRUE[None] + [0.05, 0, 0], joint_names=np.array(LIMB_JOINTS))
    assert unchanged(2) in call(root)
    assert [round(r["me_mpjpe"]) for r in document(root)["records"]] == [20, 50, 20]
    records = json.loads((root / "truth.json").read_text())
    records[2]["joints"] = dict(zip(LIMB_JOINTS, (TRUE + np.array([0.02, 0, 0])).tolist(), strict=True))
    (root / "truth.json").write_text(json.dumps(records))
    assert unchanged(2) in call(root)
    assert [round(r["me_mpjpe"]) for r in document(root)["records"]] == [20, 50, 0]
    (root.parent / "theirs" / "p0.npz").unlink()
    assert unchanged(2) in call(root)
    assert document(root)["records"][0]["reason"] == "no result"


def test_a_journal_that_ends_within_a_line_is_continued(root: Path):
    call(root)
    journal = root.parent / "out" / "scores" / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-40])
    before = document(root)
    assert unchanged(2) in call(root)
    assert document(root) == before


def test_options_that_change_figures_stand_over_the_tables(root: Path):
    call(root)
    out = root.parent / "out"
    assert (out / "table.txt").read_text().startswith("calibrated, 3 frames\n\n")
    call(root, "--limit", "2")
    words = "calibrated, 2 frames, with --limit 2"
    assert (out / "table.txt").read_text().splitlines()[0] == words
    assert (out / "table.md").read_text().splitlines()[0] == words
    assert (out / "table.tex").read_text().splitlines()[0] == f"% {words}"
    assert document(root)["header"] == words
