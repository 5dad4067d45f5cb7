"""The commands ``physic evaluate``: list, show, and one command per data set."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_bench.datasets import DATA_SETS, data_set
from physic_bench.wording import counted
from physic_core.cli.arguments import AnyPath
from physic_core.cli.output import echo
from physic_core.errors import InputError

if TYPE_CHECKING:
    from physic_bench.bodies import BodyFiles
    from physic_bench.contract import Frame
    from physic_bench.datasets.base import DataSet
    from physic_bench.evaluation import Method
    from physic_bench.reconstruct import ReconstructionSettings


class _DataSets(click.Group):
    """A group with a command for each data set, which is imported when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return [*super().list_commands(ctx), *DATA_SETS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command of the group, or that of a data set."""
        return _command_of(cmd_name) if cmd_name in DATA_SETS else super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List commands, then data sets, without importing these."""
        with formatter.section("Commands"):
            own = {name: command.get_short_help_str(90) for name, command in self.commands.items()}
            formatter.write_dl(sorted(own.items()))
        with formatter.section("Data sets"):
            formatter.write_dl(list(DATA_SETS.items()))


@click.group(cls=_DataSets)
def evaluate() -> None:
    """Measure results on data sets with ground truth, beside those of other methods."""


@evaluate.command("list")
def list_() -> None:
    """List the data sets."""
    width = max(map(len, DATA_SETS))
    for name, summary in DATA_SETS.items():
        echo(f"{name.ljust(width)}  {summary}")


@evaluate.command()
@click.argument("name", metavar="DATASET", type=click.Choice(list(DATA_SETS)))
@click.argument("root", required=False, type=click.Path(path_type=Path))
def show(name: str, root: Path | None) -> None:
    """Show what a data set needs: what to get where, under which terms, the folders, and what is missing in ROOT."""
    chosen = data_set(name)
    about = chosen.describe()
    echo(f"{name}: {about.title}\n\nWhat to get:")
    for source in about.sources:
        echo(f"  {source.what}\n    from   {source.where}\n    terms  {source.terms}")
    echo(f"\nFolders:\n{_indented(about.tree)}\n\nHow it is measured:")
    for note in about.notes:
        echo(f"  - {note}")
    if root is not None:
        missing = chosen.check(root, chosen.Options())
        echo(f"\nMissing in {root}:" if missing else f"\nNothing is missing in {root}.")
        for sentence in missing:
            echo(f"  {sentence}")


def _indented(text: str) -> str:
    return "\n".join(f"  {line}" for line in text.splitlines())


_COMMON = (
    click.Argument(["root"], type=click.Path(path_type=Path)),
    click.Option(["-o", "--out"], type=click.Path(path_type=Path), required=True, help="Folder for the results."),
    click.Option(
        ["--results"],
        metavar="[NAME=][READER:]FOLDER",
        multiple=True,
        help="Score results that exist; READER is physic, plain, physic-release or physic-release-init. May be "
        "repeated. The first is compared with all others.  [default reader: physic]",
    ),
    click.Option(["--preset"], metavar="NAME", help="Reconstruct the pictures with this preset, and score that."),
    click.Option(
        ["--config"],
        metavar="FILE",
        type=AnyPath(),
        help="Reconstruct them with this TOML file, or as reconstruction.json of a run says, and score that.",
    ),
    click.Option(
        ["--set", "overrides"],
        metavar="KEY=VALUE",
        multiple=True,
        help="Change one value of the configuration.",
    ),
    click.Option(["--no-camera"], is_flag=True, help="Do not give the true camera to the pipeline."),
    click.Option(
        ["--smplx"], type=click.Path(path_type=Path, exists=True), help="SMPL-X model file, or folder of them."
    ),
    click.Option(["--smpl"], type=click.Path(path_type=Path, exists=True), help="SMPL model file, or folder of them."),
    click.Option(["--workers"], type=click.IntRange(1), default=1, show_default=True, help="Processes."),
    click.Option(["--limit"], metavar="N", type=click.IntRange(1), help="N frames, evenly spaced over all."),
)


def _command_of(name: str) -> click.Command:
    """Return the command of a data set, with the options of its own."""
    chosen = data_set(name)
    own = [_option_of(entry.name, entry.default, entry.metadata) for entry in fields(chosen.Options)]
    return click.Command(
        name,
        params=[*_COMMON, *own],
        callback=_callback(chosen),
        help=f"{chosen.describe().title} `physic evaluate show {name}` lists the files of ROOT.",
        short_help=DATA_SETS[name],
    )


def _option_of(name: str, default: Any, metadata: Mapping[str, Any]) -> click.Option:
    return click.Option(["--" + name.replace("_", "-")], default=default, show_default=bool(default), **metadata)


def _callback(chosen: DataSet) -> Callable[..., None]:
    names = {entry.name for entry in fields(chosen.Options)}

    def run(**given: Any) -> None:
        own = chosen.Options(**{name: given.pop(name) for name in names})
        _evaluate(chosen, own, _Given(**given))

    return run


@dataclass(frozen=True)
class _Given:
    """Options of every data set's command, named as on the command line."""

    root: Path
    out: Path
    results: tuple[str, ...]
    preset: str | None
    config: Path | None
    overrides: tuple[str, ...]
    no_camera: bool
    smplx: Path | None
    smpl: Path | None
    workers: int
    limit: int | None


def _evaluate(chosen: DataSet, options: Any, given: _Given) -> None:
    """Check everything that can be wrong before anything is computed; then reconstruct, score and write."""
    if given.preset is not None and given.config is not None:
        raise click.UsageError('--preset cannot be combined with --config: write extends = "NAME" into the file')
    if not given.root.is_dir():
        raise InputError(f"there is no folder {given.root}")
    missing = chosen.check(given.root, options, pictures=_reconstructs(given))
    if missing:
        lines = "\n".join(f"  {sentence}" for sentence in missing)
        raise InputError(
            f"{given.root} is not complete for '{chosen.name}'; `physic evaluate show {chosen.name}` lists what to get "
            f"where. Missing:\n{lines}"
        )
    from physic_bench.bodies import BodyFiles
    from physic_bench.carry import Carrier
    from physic_bench.output import check_output, write_evaluation
    from physic_bench.run import evaluate_methods, require_any_truth
    from physic_core.files.atomic import MARK, check_writable

    bodies = BodyFiles(given.smplx, given.smpl)
    check_writable(given.out)
    check_output(given.out)
    methods = _methods(given, bodies)
    how = _reconstruction(given)
    if _reconstructs(given):
        how.check()
    found = chosen.frames(given.root, options, bodies, given.limit)
    if not found.frames:
        raise InputError(
            f"no frame of {given.root} can be evaluated: {next(iter(found.left_out.values()), 'it is empty')}"
        )
    echo(counted(len(found.frames), "frame"), err=True)
    for note in found.notes:
        echo(note, err=True)
    require_any_truth(found.frames, given.root)
    if _reconstructs(given):
        methods.insert(0, _own_method(found.frames, how, given.out, bodies))
    evaluation = evaluate_methods(
        chosen, found, methods, Carrier(bodies), given.root, given.workers, lambda text: echo(text, err=True), given.out
    )
    header = _header(chosen, options, given, len(found.frames))
    settings = {"data_set": chosen.name, "options": vars(options), "header": header}
    files = write_evaluation(evaluation, given.out, settings)
    echo((given.out / "table.txt").read_text(encoding="utf-8").removesuffix(f"{MARK}\n"))
    for file in files:
        if file.parent == given.out:
            echo(f"wrote {file}")


def _header(chosen: DataSet, options: Any, given: _Given, frames: int) -> str:
    """Return the line over the tables: the data set, and every option that changes the figures."""
    changed = [
        f"--{entry.name.replace('_', '-')} {getattr(options, entry.name)}"
        for entry in fields(chosen.Options)
        if getattr(options, entry.name) != entry.default
    ]
    if given.limit is not None:
        changed.append(f"--limit {given.limit}")
    if _reconstructs(given):
        changed += ["--no-camera"] * given.no_camera + [f"--set {text}" for text in given.overrides]
    words = f"{chosen.name}, {counted(frames, 'frame')}"
    return f"{words}, with {', '.join(changed)}" if changed else words


def _reconstructs(given: _Given) -> bool:
    """Whether the pictures are reconstructed."""
    return given.preset is not None or given.config is not None or not given.results


def _reconstruction(given: _Given) -> ReconstructionSettings:
    from physic_bench.reconstruct import ReconstructionSettings

    return ReconstructionSettings(
        given.preset, given.config, given.overrides, given.workers, with_camera=not given.no_camera
    )


def _own_method(frames: tuple[Frame, ...], how: ReconstructionSettings, out: Path, bodies: BodyFiles) -> Method:
    """Reconstruct the pictures, and return that as a method."""
    from physic_bench.evaluation import Method
    from physic_bench.readers import open_reader
    from physic_bench.reconstruct import reconstruct_frames

    folder = out / "reconstructions"
    failures = reconstruct_frames(frames, folder, how, lambda text: echo(text, err=True))
    name = f"physic {how.preset or (how.config.stem if how.config else 'embedded')}"
    return Method(name, open_reader("physic", folder, bodies), failures=failures)


def _methods(given: _Given, bodies: BodyFiles) -> list[Method]:
    """Return the methods of --results."""
    from physic_bench.evaluation import Method
    from physic_bench.readers import READERS, open_reader

    methods: list[Method] = []
    for text in given.results:
        name, separator, rest = text.partition("=")
        name, rest = (name, rest) if separator else ("", text)
        kind, separator, folder = rest.partition(":")
        if separator and kind not in READERS and not Path(rest).is_dir():
            raise click.UsageError(f"no reader is named '{kind}': choose one of {', '.join(READERS)}")
        kind, folder = (kind, folder) if separator and kind in READERS else ("physic", rest)
        reader = open_reader(kind, Path(folder), bodies)
        name = name or (Path(folder).resolve().name if kind in ("physic", "plain") else kind)
        if name in (".", ".."):  # previews lie in a folder of this name
            raise click.UsageError(f"no results can be named '{name}': give another name, as --results NAME={rest}")
        if any(method.name == name for method in methods):
            raise click.UsageError(f"two results are named '{name}': give names, as --results NAME={rest}")
        methods.append(Method(name, reader))
    return methods
