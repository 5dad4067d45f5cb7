"""``physic completion``: a shell completes commands, options, their values and files; a broken plugin to nothing."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from physic_core.cli import main

PLUGIN = """
from physic_core import CommandRecord, hookimpl

@hookimpl
def physic_commands():
    return [CommandRecord("configured", "physic_nowhere:configured"), CommandRecord("lost", "physic_nowhere:lost")]
"""


def offered(*words: str) -> str:
    """Return what click offers for the last word, one in a line, as the scripts of the shells read it."""
    environment = {
        "_PHYSIC_COMPLETE": "bash_complete",
        "COMP_WORDS": " ".join(("physic", *words)),
        "COMP_CWORD": str(len(words)),
    }
    done = CliRunner().invoke(main, [], env=environment, prog_name="physic")
    assert done.stderr == ""
    return " ".join(done.stdout.splitlines())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("c",), "plain,cache plain,completion plain,config"),
        (("run", "--focal"), "plain,--focal-px"),
        (("config", "s"), "plain,schema plain,show"),
        (("run", "--preset", "mo"), "plain,mock"),
        (("batch", "--save", "f"), "plain,full"),
        (("run", "pho"), "file,pho"),
        (("batch", "pho"), "file,pho"),
        (("run", "--config", "pho"), "file,pho"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_words_are_completed(words: tuple[str, ...], expected: str):
    assert offered(*words) == expected


def test_the_command_of_a_broken_plugin_completes_to_nothing(site: Any):
    site.install("physic-broken", PLUGIN)
    assert offered("con") == "plain,config"
    assert offered("lost", "--") == ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_calls_physic(shell: str):
    done = CliRunner().invoke(main, ["completion", shell])
    assert done.exit_code == 0
    assert f"_PHYSIC_COMPLETE={shell}_complete" in done.stdout


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes(tmp_path: Path):
    (tmp_path / "script").write_text(CliRunner().invoke(main, ["completion", "bash"]).stdout)
    (tmp_path / "physic").write_text(f'#!/bin/sh\nexec {sys.executable} -P -m physic_core "$@"\n')
    (tmp_path / "physic").chmod(0o755)
    call = "source ./script; COMP_WORDS=(physic config s); COMP_CWORD=2; _physic_completion ./physic"
    done = subprocess.run(
        ["bash", "-c", f"{call}; echo ${{COMPREPLY[@]}}"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("schema show\n", "")
