"""Results of ``physic bench accuracy``: tables, notes and JSON document."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from physic_bench.tables import Tables
from physic_bench.worlds.ablation import FULL
from physic_bench.worlds.columns import COLUMNS, records_of
from physic_bench.worlds.world_evidence import source_hash

if TYPE_CHECKING:
    from physic_bench.worlds.run_worlds import BenchmarkJob

    Record = Mapping[str, Any]


def tables_of(records: Sequence[Record], work: BenchmarkJob) -> Tables | None:
    """Return the figures of all rows, and the differences from the full model; None without a
    record.

    Args:
        records: of completed worlds, in any order.
        work: configuration and table rows.
    """
    if not records:
        return None
    order = sorted(records, key=lambda record: str(record["name"]))
    keys = [row.key for row in work.rows]
    return Tables.of(
        {key: records_of(order, key) for key in (*keys, "truth")},
        COLUMNS,
        FULL if FULL in keys else keys[0],
    )


def notes_of(records: Sequence[Record], work: BenchmarkJob) -> list[str]:
    """Return what the rows are, and who is missing in each, a sentence each."""
    notes = []
    for row in work.rows:
        own = [record["rows"][row.key] for record in records]
        people = [person for found in own for person in found["people"]]
        counts = {
            "missed": sum(not person["found"] for person in people),
            "not optimised": sum(bool(person["found"] and person["why"]) for person in people),
            "worlds with an error": sum(bool(found["error"]) for found in own),
        }
        stated = "".join(f"; {what}: {count}" for what, count in counts.items() if count)
        notes.append(f"{row.key}: {row.label}; {len(people)} people{stated}")
    notes.append("truth: the true bodies in the true scene; its distances are not zero")
    notes.append("people without a body score 0 in contact, and count in no other figure")
    alarms = sum(record["false_alarms"] for record in records)
    notes += [f"{alarms} bodies match no person"] * bool(alarms)
    blind = [record for record in records if record["error"]]
    notes += [
        f"{r['name']}: {r['error'].splitlines()[0]}: its people count as missed" for r in blind
    ]
    return notes


def document_of(
    records: Sequence[Record], asked: int, work: BenchmarkJob, settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the JSON document without the figures.

    Args:
        records: of completed worlds.
        asked: number of worlds that were asked for.
        work: configuration and table rows.
        settings: options of the command.
    """
    rows = {
        r.key: {"label": r.label, "engine": None if r.settings is None else asdict(r.settings)}
        for r in work.rows
    }
    return {
        "benchmark": "accuracy",
        "complete": len(records) == asked,
        "worlds_asked": asked,
        "worlds_done": len(records),
        "versions": _versions(work),
        "settings": {**settings, "rows": rows},
        "worlds": list(records),
    }


def _versions(work: BenchmarkJob) -> dict[str, str]:
    """Return the versions of packages, worlds and backends."""
    import numpy
    import torch

    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.entry_points import core_version

    backends = resolve(work.config).backends.values()
    return {
        "worlds": f"source {source_hash('physic_testing/worlds', 'physic_core/body')}",
        "physic-core": core_version(),
        "numpy": numpy.__version__,
        "torch": torch.__version__,
        **{found.provenance.distribution: found.provenance.version for found in backends},
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }
