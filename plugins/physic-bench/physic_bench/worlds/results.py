"""Results of ``physic bench accuracy``: JSON document and tables."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physic_bench.worlds.contact_partners import PARTNER_METRICS
from physic_bench.worlds.evaluation import PERSON_METRICS, WORLD_METRICS
from physic_bench.worlds.summary import by_action, row_statistics, truth_statistics
from physic_bench.worlds.support_scores import SUPPORT_METRICS
from physic_bench.worlds.table_rows import FULL, TRIAL
from physic_bench.worlds.tables import accuracy_tables, as_markdown, as_text, trial_table
from physic_bench.worlds.world_evidence import source_hash
from physic_core.files.atomic import MARK, atomic_write, check_own
from physic_core.files.strict_json import to_json
from physic_core.metrics import DRAWS

if TYPE_CHECKING:
    from physic_bench.worlds.run_worlds import BenchmarkJob
    from physic_bench.worlds.summary import RowStatistics
    from physic_bench.worlds.tables import Table
    from physic_bench.worlds.world_evidence import WorldCase

_NAMES = ("table.txt", "table.md", "results.json")

SCHEMA = 2
"""Version of the JSON document. Version 2 writes NaN as "NaN", version 1 as null."""


@dataclass(frozen=True)
class Results:
    """Results of a complete or interrupted run.

    Attributes:
        document: JSON document.
        tables: tables for printing.
        figures: row -> statistics; empty if no world was completed.
    """

    document: Mapping[str, Any]
    tables: tuple[Table, ...]
    figures: Mapping[str, RowStatistics]


def summarise_records(
    records: Sequence[Mapping[str, Any]], cases: Sequence[WorldCase], work: BenchmarkJob, settings: Mapping[str, Any]
) -> Results:
    """Build the JSON document and tables from the completed records.

    Args:
        records: records of completed worlds, in any order.
        cases: all requested worlds.
        work: configuration and table rows.
        settings: options of the command, for the document.
    """
    place = {(case.name, case.seed): i for i, case in enumerate(cases)}
    records = sorted(records, key=lambda record: place[record["name"], record["seed"]])
    labels = {row.key: row.label for row in work.rows}
    found: dict[str, RowStatistics] = {}
    tables: tuple[Table, ...] = ()
    actions: dict[str, Any] = {}
    truth: Mapping[str, Any] = {}
    if records:
        found = {key: row_statistics(records, key) for key in labels}
        truth, actions = truth_statistics(records), by_action(records, list(labels))
        blind = [f"{r['name']} {r['seed']}: {r['error'].splitlines()[0]}" for r in records if r["error"]]
        tables = accuracy_tables(found, labels, truth, actions, blind)
        if FULL in found and TRIAL in found:
            title = f"{len(records)}, seed {settings.get('seed')}"
            tables = (trial_table(found[TRIAL], found[FULL], labels[TRIAL].removeprefix("full, "), title), *tables)
    document = {
        "schema": SCHEMA,
        "note": MARK,
        "benchmark": "accuracy",
        "complete": len(records) == len(cases),
        "worlds_asked": len(cases),
        "worlds_done": len(records),
        "versions": _versions(work),
        "settings": {**settings, "rows": {r.key: {"label": r.label, "engine": _engine(r.settings)} for r in work.rows}},
        "metrics": {**PERSON_METRICS, **WORLD_METRICS, **PARTNER_METRICS, **SUPPORT_METRICS},
        "interval": f"95 %, percentile bootstrap over worlds, {DRAWS} draws",
        "summary": {key: _row_summary(f) for key, f in found.items()},
        "truth": {name: asdict(figure) for name, figure in truth.items()},
        "actions": actions,
        "failures": _failures(records),
        "worlds": list(records),
    }
    return Results(to_json(document, digits=7), tables, found)


def check_results(folder: Path) -> None:
    """Raise OutputError if a benchmark would replace a file of the user."""
    check_own(*(folder / name for name in _NAMES))


def write_results(results: Results, folder: Path) -> tuple[Path, ...]:
    """Write ``table.txt``, ``table.md`` and, last, ``results.json``; each completely or not at all.

    Raises:
        OutputError: the folder cannot be written.
    """
    texts = (
        "\n\n\n".join([*map(as_text, results.tables), MARK]),
        "\n\n".join([*map(as_markdown, results.tables), MARK]),
        json.dumps(results.document, indent=1, ensure_ascii=False),
    )
    with atomic_write(folder) as temporary:
        for name, text in zip(_NAMES, texts, strict=True):
            temporary(name).write_text(f"{text}\n", encoding="utf-8")
    return tuple(folder / name for name in _NAMES)


def _row_summary(row: RowStatistics) -> dict[str, Any]:
    """Return the statistics of a row as a dict."""
    counts = ("people", "missed", "left_at_start", "false_alarms", "errors")
    return {
        **{name: getattr(row, name) for name in counts},
        "figures": {name: asdict(figure) for name, figure in row.figures.items()},
    }


def _failures(records: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """List the people without a body or without optimisation in each row, with the reason."""
    return [
        {"world": record["name"], "seed": record["seed"], "row": key, "person": i, "found": p["found"], "why": p["why"]}
        for record in records
        for key, row in record["rows"].items()
        for i, p in enumerate(row["people"])
        if p["why"]
    ]


def _engine(settings: Any) -> dict[str, Any] | None:
    """Return engine settings as a dict; None for the start row."""
    return None if settings is None else asdict(settings)


def _versions(work: BenchmarkJob) -> dict[str, Any]:
    """Return the versions of packages, worlds and plugins."""
    import numpy
    import scipy
    import torch

    from physic_core.discovery.plugins import core_version

    return {
        "physic-core": core_version(),
        "worlds": f"source {source_hash(('physic_testing/worlds', 'physic_core/body'))}",
        **_plugin_versions(work),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "torch": torch.__version__,
    }


def _plugin_versions(work: BenchmarkJob) -> dict[str, Any]:
    """Return the version of each plugin distribution, and of its noise model if it defines one."""
    import sys

    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover

    answer: dict[str, Any] = {}
    for found in resolve(work.config, discover()).backends.values():
        who = found.provenance
        answer[who.distribution] = who.version
        noise = getattr(sys.modules.get(who.plugin), "NOISE_VERSION", None)
        if noise is not None:
            answer[f"{who.distribution} noise"] = str(who.options.get("version", noise))
    return answer
