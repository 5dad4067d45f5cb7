"""The container files: what they must state, without building them.

``hadolint`` checks them where it is installed.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = ["Containerfile", "Containerfile.cuda"]


def instructions(name):
    """The instructions of a file with their arguments, continued lines joined."""
    text = re.sub(r"^#.*\n", "", (ROOT / name).read_text(), flags=re.M).replace("\\\n", " ")
    pairs = (line.partition(" ") for line in text.splitlines() if line.strip())
    return [(word, " ".join(rest.split())) for word, _, rest in pairs]


def last_stage(name):
    found = instructions(name)
    return found[max(i for i, (word, _) in enumerate(found) if word == "FROM") :]


@pytest.mark.parametrize("name", FILES)
def test_the_image_runs_physic_as_a_user_without_privileges(name):
    stage = last_stage(name)
    assert ("USER", "1000") in stage
    after = stage[stage.index(("USER", "1000")) :]
    assert [word for word, _ in after] == ["USER", "WORKDIR", "ENTRYPOINT", "CMD"]
    assert ("ENTRYPOINT", '["physic"]') in after
    assert any(word == "RUN" and "useradd --uid 1000" in rest for word, rest in stage)


def test_the_build_gets_what_it_installs_and_no_more():
    lines = (ROOT / ".containerignore").read_text().splitlines()
    assert (ROOT / ".dockerignore").read_text() == (ROOT / ".containerignore").read_text()
    kept = {line[1:] for line in lines if line.startswith("!")}
    assert "*" in lines
    assert all((ROOT / name).exists() for name in kept)
    needed = {
        line.split()[-1].partition("/")[0]
        for line in (ROOT / "requirements.txt").read_text().splitlines()[1:]
    }
    assert needed - {".", "constraints.txt"} <= kept
    assert {
        "physic_core",
        "pyproject.toml",
        "README.md",
        "LICENSE",
        "NOTICE",
        "constraints.txt",
        "requirements.txt",
    } <= kept
