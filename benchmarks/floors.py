"""Count wrong floors in rooms of worlds, after stages 1 and 2 of the engine.

    python -m benchmarks.floors --seed 1 --rooms 400 --jobs 2 [--evidence FOLDER] [--json FILE]

A floor is wrong if its normal is off by more than 30 degrees, and right if it is off by less than 10. The worlds have
the noise of version 4 and other bodies. With ``--evidence`` the outputs of the estimators are kept for the next run.
Needs the plugins physic-testing and physic-mock.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

WRONG_DEG, RIGHT_DEG = 30.0, 10.0
SIZE = (320, 240)
OUTDOORS = ("slope", "outdoor_steps")


def main() -> None:
    """Run stages 1 and 2 on the rooms, and print the numbers of floors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--rooms", type=int, default=400)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--evidence", type=Path, help="folder of the estimators' outputs")
    parser.add_argument("--json", type=Path, help="one record for each room")
    given = parser.parse_args()
    records = []
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        work = [pool.submit(floor_record, case, given.evidence) for case in rooms(given.rooms, given.seed)]
        for future in as_completed(work):
            records.append(future.result())
            print(f"[{len(records)}/{len(work)}] {records[-1]['title']}", file=sys.stderr, flush=True)
    if given.json is not None:
        given.json.write_text(json.dumps(sorted(records, key=lambda record: str(record["title"])), indent=1))
    print(
        "\n".join(f"{count:5d} {kind}" for kind, count in Counter(kind_of(record) for record in records).most_common())
    )


def rooms(count: int, seed: int) -> Iterator[Any]:
    """Yield worlds of everyday actions in rooms."""
    from physic_bench.worlds.world_evidence import benchmark_cases, with_other_bodies

    cases = (case for case in benchmark_cases(2 * count, seed, SIZE) if case.name not in OUTDOORS)
    yield from with_other_bodies(case for case, _ in zip(cases, range(count), strict=False))


def kind_of(record: dict[str, Any]) -> str:
    """Return whether a floor is right, off or wrong, or why there is none."""
    return f"none: {record['reason']}" if record["angle_deg"] is None else _grade(record["angle_deg"])


def _grade(angle: float) -> str:
    return "right" if angle < RIGHT_DEG else "wrong" if angle > WRONG_DEG else "off by 10 to 30 degrees"


@cache
def _setup() -> tuple[Any, Any]:
    import torch

    from physic_core import load_config
    from physic_core.body import load_body
    from physic_core.configuration.resolve import resolve
    from physic_core.discovery.plugins import discover
    from physic_core.interfaces import INTERFACES

    torch.set_num_threads(1)
    mocks: dict[str, Any] = {name: {"options": {"noise": 1}} for name in INTERFACES}
    mocks["segmenter"]["options"] |= {"surfaces": True}
    plan = resolve(load_config(preset="mock", flags={"noise": mocks}), discover())
    return plan, load_body(plan.body_model)


def floor_record(case: Any, evidence: Path | None) -> dict[str, Any]:
    """Return the floor of one room after stage 2 against the true one."""
    from physic_bench.worlds.world_evidence import estimate_evidence
    from physic_core.errors import PhysicError
    from physic_core.pipeline import optimise
    from physic_core.pipeline.stage_runner import StageRunner
    from physic_testing.worlds import build_world

    plan, model = _setup()
    world = build_world(case.name, case.seed, case.size)
    record: dict[str, Any] = {"title": case.title, "angle_deg": None, "reason": "found"}
    try:
        estimates = estimate_evidence(case, world, plan, model, evidence)
    except PhysicError as error:
        return record | {"reason": type(error).__name__}
    with patch.object(optimise, "joint_problem", side_effect=_SolvedError) as stopped:
        try:
            optimise.run_engine(estimates, plan.engine, model, StageRunner("cpu", 4))
        except _SolvedError:
            scene = stopped.call_args.args[1].scene
    truth = world.floor.normal
    record["reason"] = scene.diagnostics["floor"]["reason"]
    if scene.floor_normal is not None:
        record["angle_deg"] = _angle(scene.floor_normal, truth)
    return record


class _SolvedError(Exception):
    """Stage 2 has ended."""


def _angle(normal: Any, truth: Any) -> float:
    import numpy as np

    return float(np.degrees(np.arccos(np.clip(np.asarray(normal, np.float64) @ truth, -1, 1))))


if __name__ == "__main__":
    main()
