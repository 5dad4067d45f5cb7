"""Command ``physic bench``: accuracy of the engine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from physic_core.cli.arguments import AnyPath
from physic_core.cli.output import echo
from physic_core.errors import ConfigError

if TYPE_CHECKING:
    from physic_bench.worlds.frames import BenchmarkJob
    from physic_core.configuration.model import Config


@click.group()
def bench() -> None:
    """Measure the accuracy of the engine.

    "accuracy" needs the plugin physic-mock. In a checkout of PhySIC:
    pip install -e plugins/physic-testing -e plugins/physic-mock
    """


@bench.command()
@click.option(
    "--world",
    "worlds",
    metavar="NAME",
    multiple=True,
    help="A world; repeat for more.  [default: all]",
)
@click.option(
    "--preset",
    metavar="NAME",
    default="default",
    show_default=True,
    help="Engine's preset, the full model.",
)
@click.option(
    "--noise-seed",
    metavar="K",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Draws the errors.",
)
@click.option(
    "--rows",
    metavar="NAME,...",
    default="",
    help="Rows of the table, or other presets of the engine.",
)
@click.option(
    "--set",
    "overrides",
    metavar="KEY=VALUE",
    multiple=True,
    help="A setting of the engine (joint.depth.weight=10) makes a trial beside the full row; one "
    "of a backend "
    "(metric_depth.options...) changes all rows. May be repeated.",
)
@click.option(
    "--jobs", metavar="J", type=click.IntRange(1), default=1, show_default=True, help="Processes."
)
@click.option(
    "-o", "--out", type=AnyPath(), default=Path("physic-bench"), show_default=True, help="Folder."
)
def accuracy(
    worlds: tuple[str, ...],
    preset: str,
    noise_seed: int,
    rows: str,
    overrides: tuple[str, ...],
    jobs: int,
    out: Path,
) -> None:
    """Print the ablation table on synthetic worlds with ground truth; write the tables and all
    values to --out.

    After Ctrl-C, the same command continues the run.
    """
    trial, others = _split(overrides)
    config, noisy = _configs(preset, noise_seed, trial, others)

    from physic_bench.tables import check_results
    from physic_core.configuration.resolve import require_available, resolve
    from physic_core.files.atomic import check_writable

    resolve(config)
    require_available(resolve(noisy))
    names = _names(worlds)
    check_results(check_writable(out))

    from physic_bench.worlds.ablation import FULL, TRIAL, TableRow, select_rows
    from physic_bench.worlds.frames import BenchmarkJob

    keys = [key.strip() for key in rows.split(",") if key.strip()]
    chosen = select_rows(preset, keys or ([FULL] if trial else []))
    if trial:
        label = "full, " + ", ".join(text.partition(".")[2] for text in trial)
        chosen = (*chosen, TableRow(TRIAL, label, config.engine.settings()))
    work = BenchmarkJob(noisy, chosen, out / "rows")
    settings: dict[str, Any] = {"worlds": names, "preset": preset, "noise_seed": noise_seed}
    settings |= {"set": list(overrides), "config": noisy.as_dict()}
    _run(names, work, jobs, out, settings)


def _names(chosen: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the chosen worlds, or of all."""
    from physic_testing.worlds import WORLDS

    for name in chosen:
        if name not in WORLDS:
            raise ConfigError(f"no world named '{name}'; there are: {', '.join(WORLDS)}")
    return chosen or WORLDS


def _split(overrides: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Split overrides into engine settings, such as "engine.joint.x=1", and backend settings."""
    stages = ("scene.", "placement.", "joint.", "contact.")
    full = [
        f"engine.{text}" if text.strip().startswith(stages) else text.strip() for text in overrides
    ]
    if any(text.startswith("engine.preset") for text in full):
        raise ConfigError(
            "--set engine.preset=...: say it with --preset NAME, or with --rows full,NAME"
        )
    return [t for t in full if t.startswith("engine.")], [
        t for t in full if not t.startswith("engine.")
    ]


def _configs(
    preset: str, noise_seed: int, trial: list[str], others: list[str]
) -> tuple[Config, Config]:
    """Return the trial's config, and the config of the estimators, which all rows share.

    Backends of other plugins have a noise seed, and errors of their own.
    """
    from physic_core.configuration.model import load_config
    from physic_core.interfaces import INTERFACES

    usual = load_config(preset="mock")
    chosen = load_config(preset="mock", overrides=others)
    noise: dict[str, dict[str, dict[str, int]]] = {}
    for name in INTERFACES:
        noise[name] = {"options": {"noise_seed": noise_seed}}
        if chosen.choice(name).backend == usual.choice(name).backend:
            noise[name]["options"]["noise"] = 1
    engine = {"engine": {"preset": preset}}
    return (
        load_config(
            preset="mock",
            overrides=[*others, *trial],
            flags={"--noise-seed": noise, "--preset": engine},
        ),
        load_config(preset="mock", overrides=others, flags={"--noise-seed": noise}),
    )


def _run(
    worlds: tuple[str, ...], work: BenchmarkJob, jobs: int, out: Path, settings: dict[str, Any]
) -> None:
    """Run the benchmark, write the results and print the tables."""
    from dataclasses import asdict

    from physic_bench.bodies import BodyFiles
    from physic_bench.run import Method, evaluate_methods
    from physic_bench.scoring import columns_for
    from physic_bench.tables import Tables, write_results
    from physic_bench.worlds.ablation import FULL
    from physic_bench.worlds.frames import solve_worlds, world_frames
    from physic_core.files.atomic import MARK

    failures: dict[str, dict[str, str]] = {row.key: {} for row in work.rows}
    for count, (name, failed) in enumerate(solve_worlds(worlds, work, jobs), 1):
        for key, reason in failed.items():
            failures[key][name] = reason
        echo(f"[{count}/{len(worlds)}] {name}{' failed' if failed else ''}", err=True)
    methods = [Method(row.key, "plain", work.results(row), failures[row.key]) for row in work.rows]
    evaluation = evaluate_methods(world_frames(worlds), methods, BodyFiles())
    tables = Tables.of(
        evaluation.records, columns_for(["annotated"]), FULL if FULL in failures else ""
    )
    rows = {
        row.key: {"label": row.label, "engine": row.settings and asdict(row.settings)}
        for row in work.rows
    }
    document = {"settings": {**settings, "rows": rows}, "records": evaluation.records}
    notes = [*(f"{row.key}: {row.label}" for row in work.rows), *evaluation.notes]
    paths = write_results(tables, out, f"{len(worlds)} worlds", notes, document)
    echo(paths[0].read_text(encoding="utf-8").removesuffix(f"{MARK}\n"))
    echo(f"wrote {', '.join(map(str, paths))}")
