"""The commands ``physic evaluate``: one per data set."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_bench.datasets import DATA_SETS, data_set
from physic_core.cli.arguments import AnyPath, WholeNumber
from physic_core.cli.output import echo
from physic_core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from physic_batch.photo_processor import BatchJob
    from physic_bench.datasets.base import DataSet, FrameSet
    from physic_bench.evaluation import Method
    from physic_bench.types import Frame


class _DataSets(click.Group):
    """A group with a command for each data set, which is imported when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all data sets."""
        return list(DATA_SETS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of a data set."""
        return _command_of(data_set(cmd_name)) if cmd_name in DATA_SETS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the data sets without importing them."""
        with formatter.section("Data sets"):
            formatter.write_dl(list(DATA_SETS.items()))


@click.group(cls=_DataSets)
def evaluate() -> None:
    """Measure results on data sets with ground truth, beside those of other methods.

    "physic evaluate DATASET --help" states what to download, from where, under which terms.
    """


@dataclass(frozen=True)
class _CommonOptions:
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
    frames: Path | None
    limit: int | None

    @property
    def reconstructs(self) -> bool:
        """Whether the pictures are reconstructed."""
        return self.preset is not None or self.config is not None or not self.results


_COMMON = (
    click.Argument(["root"], type=AnyPath()),
    click.Option(["-o", "--out"], type=AnyPath(), required=True, help="Folder for the results."),
    click.Option(
        ["--results"],
        metavar="[NAME=][READER:]FOLDER",
        multiple=True,
        help="Score existing results; READER is physic or plain. May be repeated; the first is "
        "compared with all others.  [default reader: physic]",
    ),
    click.Option(
        ["--preset"],
        metavar="NAME",
        help="Reconstruct the pictures with this preset, and score that.",
    ),
    click.Option(
        ["--config"],
        metavar="FILE",
        type=AnyPath(),
        help="Reconstruct the frames with this TOML file, or the reconstruction.json of a run, and "
        "score the results.",
    ),
    click.Option(
        ["--set", "overrides"],
        metavar="KEY=VALUE",
        multiple=True,
        help="Change one value of the configuration.",
    ),
    click.Option(
        ["--no-camera"], is_flag=True, help="Do not give the true camera to the pipeline."
    ),
    click.Option(["--smplx"], type=AnyPath(), help="SMPL-X model file, or folder of them."),
    click.Option(["--smpl"], type=AnyPath(), help="SMPL model file, or folder of them."),
    click.Option(
        ["--workers"], type=WholeNumber(1), default=1, show_default=True, help="Processes."
    ),
    click.Option(
        ["--frames"],
        metavar="FILE",
        type=AnyPath(),
        help="Text file with one frame per line: the frames to evaluate.",
    ),
    click.Option(
        ["--limit"], metavar="N", type=WholeNumber(1), help="N frames, evenly spaced over all."
    ),
)


def _command_of(chosen: DataSet) -> click.Command:
    """Return the command of a data set, with the options of its own."""
    names = [str(option.name) for option in chosen.options]

    def run(**given: Any) -> None:
        own_options = {name: given.pop(name) for name in names}
        _evaluate(chosen, own_options, _CommonOptions(**given))

    # "\b" keeps the lines of a paragraph as they are.
    description = "\n\n".join(f"\b\n{part}" for part in chosen.description.strip().split("\n\n"))
    return click.Command(
        chosen.name, params=[*_COMMON, *chosen.options], callback=run, help=description
    )


def _require_complete(chosen: DataSet, options: dict[str, Any], common: _CommonOptions) -> None:
    missing = chosen.missing(common.root, common.reconstructs, **options)
    if missing:
        lines = "\n".join(f"  {sentence}" for sentence in missing)
        raise InputError(
            f"{common.root} is not complete; `physic evaluate {chosen.name} --help` says what to "
            f"get:\n{lines}"
        )


def _require_frames(frame_set: FrameSet, root: Path) -> None:
    if not frame_set.frames:
        reason = next(iter(frame_set.left_out.values()), "it is empty")
        raise InputError(f"no frame of {root} can be evaluated: {reason}")


def _reconstruct(
    frames: Sequence[Frame], job: BatchJob, common: _CommonOptions, report: Callable[[str], None]
) -> Method:
    """Reconstruct all frames, and return where the results are."""
    from physic_bench.evaluation import Method, reconstruct_frames

    failures = reconstruct_frames(
        frames, job, common.workers, report, with_camera=not common.no_camera
    )
    name = common.preset or (common.config.stem if common.config else "embedded")
    return Method(f"physic {name}", "physic", Path(job.out), failures)


def _evaluate(chosen: DataSet, options: dict[str, Any], common: _CommonOptions) -> None:
    """Check everything that can be wrong before anything is computed; then reconstruct, score and
    write.
    """
    if common.preset is not None and common.config is not None:
        raise click.UsageError(
            '--preset cannot be combined with --config: write extends = "NAME" into the file'
        )
    _require_complete(chosen, options, common)
    from physic_bench.bodies import BodyFiles
    from physic_bench.datasets.base import FrameChoice
    from physic_bench.evaluation import evaluate_methods
    from physic_bench.scoring import columns_with_contact_truths
    from physic_bench.tables import check_results, write_results
    from physic_core.files import MARK, check_writable

    files = BodyFiles(common.smplx, common.smpl)
    report = partial(echo, err=True)
    check_results(check_writable(common.out))
    methods = _methods(common)
    job = _job(common) if common.reconstructs else None
    frame_set = chosen.frames(
        common.root, FrameChoice(common.frames, common.limit), files, **options
    )
    _require_frames(frame_set, common.root)
    for note in (f"{len(frame_set.frames)} frames", *frame_set.notes):
        report(note)
    if job is not None:
        methods.insert(0, _reconstruct(frame_set.frames, job, common, report))
    records, scored = evaluate_methods(frame_set, methods, files)
    every = [record for rows in records.values() for record in rows]
    columns = columns_with_contact_truths(
        list(dict.fromkeys(name for record in every for name in record["contact"]))
    )
    document = {
        "data_set": chosen.name,
        "options": options,
        "methods": [{"name": m.name, "reader": m.reader, "folder": str(m.folder)} for m in methods],
        "left_out": dict(scored.left_out),
        "records": records,
    }
    title = _table_title(chosen, options, common, len(frame_set.frames))
    paths = write_results(records, columns, common.out, title, scored.notes, document)
    echo(paths[0].read_text(encoding="utf-8").removesuffix(f"{MARK}\n"))
    echo(f"wrote {', '.join(map(str, paths))}")


def _table_title(
    chosen: DataSet, options: dict[str, Any], common: _CommonOptions, frames: int
) -> str:
    """Return the line over the tables: the data set, and every option that changes the figures."""
    defaults = {option.name: option.default for option in chosen.options}
    changed = [
        f"--{name.replace('_', '-')} {value}"
        for name, value in options.items()
        if value != defaults[name]
    ]
    changed += [f"--frames {common.frames.name}"] if common.frames is not None else []
    changed += [f"--limit {common.limit}"] if common.limit is not None else []
    if common.reconstructs:
        changed += ["--no-camera"] * common.no_camera + [
            f"--set {text}" for text in common.overrides
        ]
    words = f"{chosen.name}, {frames} frames"
    return f"{words}, with {', '.join(changed)}" if changed else words


def _job(common: _CommonOptions) -> BatchJob:
    """Return the batch of the pictures.

    Raises:
        PhysicError: the configuration is invalid, files that it needs are missing, or the folder
            cannot be written.
    """
    from physic_batch.photo_processor import prepare_job
    from physic_bench.evaluation import LOGS, PICTURES
    from physic_core.configuration.model import load_config
    from physic_core.files import path_to_write

    config = load_config(common.config, preset=common.preset, overrides=common.overrides)
    folder = path_to_write(common.out, "reconstructions")
    for name in (LOGS, PICTURES):
        path_to_write(folder, name)
    return prepare_job(config, folder, "numbers", with_thumbnails=False)


def _methods(common: _CommonOptions) -> list[Method]:
    """Return the methods of --results."""
    from physic_bench.evaluation import Method
    from physic_bench.predictions import READERS

    methods: list[Method] = []
    for text in common.results:
        name, separator, rest = text.partition("=")
        name, rest = (name, rest) if separator else ("", text)
        kind, separator, folder = rest.partition(":")
        if separator and kind not in READERS and not Path(rest).is_dir():
            raise click.UsageError(
                f"no reader is named '{kind}': choose one of {', '.join(READERS)}"
            )
        kind, folder = (kind, folder) if separator and kind in READERS else ("physic", rest)
        if not Path(folder).is_dir():
            raise InputError(f"there is no folder {folder} with results of '{kind}'")
        name = name or Path(folder).resolve().name
        if any(method.name == name for method in methods):
            raise click.UsageError(
                f"two results are named '{name}': give names, as --results NAME={rest}"
            )
        methods.append(Method(name, kind, Path(folder)))
    return methods
