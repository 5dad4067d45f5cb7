"""``physic completion``: the scripts list what the command has, and complete it without starting a program."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from physic_core.cli import main
from physic_core.cli.completion import command_words, completion_script

SHELLS = ("bash", "zsh", "fish")


@pytest.fixture(scope="module")
def scripts() -> dict[str, str]:
    words = command_words(main, click.Context(main, **main.context_settings))
    return {shell: completion_script(shell, words) for shell in SHELLS}


def walk(command: click.Command, ctx: click.Context, path: tuple[str, ...] = ()) -> Iterator[tuple[str, set[str]]]:
    """Every command and its options, as click knows them."""
    parameters = [p for p in command.get_params(ctx) if isinstance(p, click.Option)]
    yield " ".join(("physic", *path)), {text for p in parameters for text in (*p.opts, *p.secondary_opts)}
    if isinstance(command, click.Group):
        for name in command.list_commands(ctx):
            inner = command.get_command(ctx, name)
            assert inner is not None
            yield from walk(inner, click.Context(inner, parent=ctx, **inner.context_settings), (*path, name))


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_lists_every_command_and_option(scripts: dict[str, str], shell: str):
    for path, options in walk(main, click.Context(main, **main.context_settings)):
        if shell == "fish":
            lines = [line for line in scripts[shell].splitlines() if f" -n '__physic_at {path}' " in line]
            named = {f"--{w.split()[0]}" for line in lines for w in line.split(" -l ")[1:]}
            named |= {f"-{line.split(' -s ')[1].split()[0]}" for line in lines if " -s " in line}
        else:
            (line,) = [line for line in scripts[shell].splitlines() if line.startswith(f"    '{path}') commands=")]
            named = set(line.split("options='")[1].split("'")[0].split())
        assert named == options, path


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        (("c",), "cache completion config"),
        (("completion", ""), ""),
        (("run", "--focal"), "--focal-px"),
        (("config", "s"), "schema show"),
        (("config", "show", "--a"), "--all"),
        (("run", "--preset", "mo"), "mock"),
        (("run", "--device", ""), ""),
        (("batch", "--save", "f"), "full"),
        (("run", "pho"), ""),
        (("-",), "--version -h --help"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_bash_completes_without_a_program(
    scripts: dict[str, str], typed: tuple[str, ...], offered: str, tmp_path: Path
):
    (tmp_path / "script").write_text(scripts["bash"])
    call = 'source "$0"; PATH=; COMP_WORDS=(physic "$@"); COMP_CWORD=$#; _physic; echo "${COMPREPLY[*]}"'
    done = subprocess.run(["bash", "-c", call, tmp_path / "script", *typed], capture_output=True, text=True, check=True)
    assert (done.stdout.strip(), done.stderr) == (offered, "")
