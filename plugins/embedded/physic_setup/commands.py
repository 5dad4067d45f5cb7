"""The command ``physic setup``: the whole way from a bare installation to a preset that runs."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from physic_core.cli.arguments import FolderPath
from physic_core.cli.exit_codes import OTHER, WEIGHTS
from physic_core.cli.output import echo
from physic_core.errors import OutputError
from physic_core.files import atomic_write, check_own, check_writable

if TYPE_CHECKING:
    from physic_setup.steps import Setup, SetupStep


@click.command()
@click.argument("preset")
@click.option(
    "--folder",
    type=FolderPath(),
    help="Folder for checkouts, your files and the configuration.  [default: physic-PRESET]",
)
@click.option(
    "--run",
    "run_steps",
    is_flag=True,
    help="Run the commands of the remaining steps; each is printed first.",
)
@click.pass_context
def setup(ctx: click.Context, preset: str, folder: Path | None, run_steps: bool) -> None:
    """Print a shell script that installs the estimators of PRESET; its comments list what you have
    to do yourself.

    The script begins with the contents of the preset, their licenses, and what we did not measure.

    --run skips the steps that are done: repeat the command to resume. It never accepts a license
    that restricts use for you. Exits with code 4 if a step remains.
    """
    from physic_core.configuration.layers import preset_comment

    setup_folder = (folder or Path(f"physic-{preset}")).absolute()
    needed = _setup_of(preset, setup_folder)
    about = preset_comment(preset)
    if not run_steps:
        echo("\n".join(_script(needed, preset, setup_folder, about)))
    else:
        echo("\n".join((*about, "")))
        for number, step in enumerate(needed.steps, 1):
            echo(f"{number}. {step.title}: {'done' if step.is_done else 'to do'}")
            if not step.is_done:
                _run_step(step)
        needed = _setup_of(preset, setup_folder)
        left = [step for step in needed.steps if not step.is_done]
        echo(f"\n{len(needed.steps) - len(left)} of {len(needed.steps)} steps are done")
        for step in left:
            echo(f"left to you: {step.title}")
            for line in step.by_hand:
                echo(f"  {line}")
        config = shlex.quote(str(setup_folder / f"{preset}.toml"))
        if not left and needed.keeps_graphs:
            _run_command(f"physic cache fill --config {config}")
        echo(f"then: physic config check --config {config}")
    ctx.exit(0 if all(step.is_done for step in needed.steps) else WEIGHTS)


def _setup_of(preset: str, folder: Path) -> Setup:
    from physic_setup.steps import read_config, setup_steps

    config, missing = read_config(folder / f"{preset}.toml", preset)
    return setup_steps(config, preset, folder, missing)


def _script(plan: Setup, preset: str, folder: Path, config_notes: list[str]) -> Iterator[str]:
    left = [step for step in plan.steps if not step.is_done]
    config = shlex.quote(str(folder / f"{preset}.toml"))
    yield f"# physic setup {preset}: {len(left)} of {len(plan.steps)} steps remain."
    yield from (f"# {line}" for line in _cost_lines(plan))
    yield from ("", *config_notes)
    for number, step in enumerate(plan.steps, 1):
        yield ""
        yield f"# {number}. {step.title}{': done' if step.is_done else ''}"
        if step.is_done:
            continue
        yield from (f"#    by hand: {line}" for line in step.by_hand)
        yield from step.commands
        if step.file is not None:
            path, text = step.file
            yield f"mkdir -p {shlex.quote(str(path.parent))}"
            yield f"cat > {shlex.quote(str(path))} <<'END'\n{text}END"
    yield ""
    if plan.keeps_graphs:
        yield f"physic cache fill --config {config}"
    yield f"physic config check --config {config}\n# physic run PHOTO --config {config}"


def _cost_lines(plan: Setup) -> Iterator[str]:
    """Yield lines about download, GPU memory, accounts and what is not pinned."""
    from physic_core.weights import format_size

    more = (
        f", and these, whose size is not published: {', '.join(plan.unsized)}"
        if plan.unsized
        else ""
    )
    yield f"Download size, without packages: {format_size(plan.download_bytes) or '0 bytes'}{more}"
    for name, memory in plan.gpu:
        yield f"GPU memory: {memory.gigabytes:g} GB for the {name} ({memory.source})"
    if plan.gpu_unknown:
        yield f"GPU memory not measured: {', '.join(plan.gpu_unknown)}"
    yield f"Accounts: {', '.join(plan.accounts) or 'none'}"
    if plan.unpinned:
        yield (
            f"Not pinned: {len(plan.unpinned)} of {len(plan.unpinned) + plan.pinned} files and "
            "repositories have neither a SHA-256 nor a commit"
        )


def _run_step(step: SetupStep) -> None:
    """Run the commands of a step, or write its file."""
    for command in step.commands:
        _run_command(command)
    if step.file is not None:
        path, text = step.file
        check_own(path)
        echo(f"   writes {path}")
        with atomic_write(check_writable(path.parent)) as temporary:
            temporary(path.name).write_text(text, encoding="utf-8")


def _run_command(command: str) -> None:
    echo(f"   $ {command}")
    words = shlex.split(command)
    if words[0] in ("python", "physic"):
        words[:1] = (
            [sys.executable, "-P", "-m", "physic_core"]
            if words[0] == "physic"
            else [sys.executable]
        )
    try:
        code = subprocess.run(words, check=False).returncode
    except OSError as error:
        raise OutputError(f"{words[0]} cannot be run: {error.strerror}") from error
    if code:
        echo(
            f"Error: this command ended with code {code}. Remove the cause, and run setup again.",
            err=True,
        )
        click.get_current_context().exit(OTHER)
