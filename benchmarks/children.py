"""Measure the statures and distances of children in worlds, alone and with adults, under version 4 of the noise.

    python -m benchmarks.children run OUT --seed 3 --worlds 40
    python -m benchmarks.children table OUT

``run`` keeps one JSON file a world and column in folders of OUT, and an interrupted run continues. The columns:
"default" takes all people of unknown age for adults, "half" is for photos of which half of the people are children,
and "age known" gives the ages of the children.
``table`` prints a Markdown table of the columns. Errors are means of absolute relative ones with a bootstrap interval
of 95 % over worlds; people who were not found are left out and counted.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

_ALONE = ("child_stands", "child_sits")
_COLUMNS: dict[str, dict[str, Any]] = {
    "default": {"child_share": 0.0},
    "half": {"child_share": 0.5},
    "age known": {},
}
_CHILD_M = 1.45  # taller children and small adults look alike


def main() -> int:
    """Run worlds or print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.children", description=(__doc__ or "").partition("\n")[0]
    )
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("out", type=Path)
    run.add_argument("--seed", type=int, required=True)
    run.add_argument("--worlds", type=int, default=40)
    run.add_argument("--depth-noise", type=float, default=1.0, help="factor on the errors of both depth maps")
    table = commands.add_parser("table")
    table.add_argument("out", type=Path)
    given = parser.parse_args()
    if given.command == "table":
        print(table_of([given.out / column for column in _COLUMNS]))
        return 0
    run_worlds(given.out, given.seed, given.worlds, given.depth_noise)
    return 0


def run_worlds(out: Path, seed: int, count: int, depth_noise: float = 1.0) -> None:
    """Reconstruct all worlds whose files are missing, with the errors of both depth maps times ``depth_noise``."""
    import torch

    from physic_core import Pipeline, load_config
    from physic_core.errors import InputError
    from physic_core.interfaces import INTERFACES
    from physic_testing.worlds import CHILD_WORLDS, benchmark_worlds, build_world

    torch.set_num_threads(1)
    settings: dict[str, Any] = {name: {"options": {"version": 4}} for name in INTERFACES}
    settings["segmenter"]["options"] |= {"surfaces": True}
    for name in ("relative_pointmap", "metric_depth"):
        settings[name]["options"] |= {"noise": depth_noise}
    with Pipeline(load_config(preset="mock", flags={"benchmark": settings})) as pipeline:
        for number, (name, own) in enumerate(benchmark_worlds(count, seed, CHILD_WORLDS)):
            for column, photo in _COLUMNS.items():
                file = out / column / f"{number:04d}.json"
                if file.exists():
                    continue
                world = build_world(name, own)
                file.parent.mkdir(parents=True, exist_ok=True)
                try:
                    people = compared(world, pipeline(world.image, settings=photo or _ages_of(world)))
                except InputError:  # a person was not found, so that no order of ages fits
                    people = []
                file.write_text(json.dumps({"name": name, "seed": own, "people": people}))
            print(f"[{number + 1}/{count}] {name} {own}", file=sys.stderr, flush=True)


def _ages_of(world: Any) -> dict[str, Any]:
    """Return the settings that give the ages of the children of a world, who are found from left to right."""
    order = np.argsort(world.boxes[:, 0] + world.boxes[:, 2], kind="stable")
    return {"age": np.nan_to_num(world.ages)[order].tolist()}


def compared(world: Any, result: Any) -> list[dict[str, Any]]:
    """Return truth and result of each person of a world; None for what was not found."""
    import torch

    from physic_core.body import load_body

    model = load_body(world.body_model)
    own = model.stature(torch.tensor(world.parameters.betas)).tolist()
    records = []
    for i, mask in enumerate(world.masks):
        overlap = [(mask & person.mask).sum() / (mask | person.mask).sum() for person in result.people]
        record: dict[str, Any] = {
            "years": None if np.isnan(world.ages[i]) else float(world.ages[i]),
            "stature": own[i],
            "depth": float(world.joints[i, 0, 2]),
            "found": None,
        }
        if overlap and max(overlap) > 0.3:
            person = result.people[int(np.argmax(overlap))]
            record["found"] = {
                "stature": float(model.stature(torch.tensor(person.parameters.betas))),
                "depth": float(person.joints[0, 2]),
                "age": None if person.age is None else vars(person.age),
            }
        records.append(record)
    return records


def table_of(folders: Sequence[Path]) -> str:
    """Return a Markdown table with one column for each folder."""
    rows = ["| figure | " + " | ".join(folder.name for folder in folders) + " |", "|---" * (len(folders) + 1) + "|"]
    worlds = [[json.loads(file.read_text()) for file in sorted(folder.glob("*.json"))] for folder in folders]
    for title, value in _FIGURES.items():
        rows.append(f"| {title} | " + " | ".join(_with_interval(one, value) for one in worlds) + " |")
    return "\n".join(rows)


Values = Callable[[dict[str, Any]], list[float]]


def _with_interval(worlds: Sequence[dict[str, Any]], values: Values) -> str:
    """Return the mean over people, its interval, and the number of people."""
    each = [own for own in (values(world) for world in worlds) if own]
    if not each:
        return "-"
    draws = np.random.default_rng(0).integers(len(each), size=(2000, len(each)))
    means = [np.mean(np.concatenate([each[k] for k in draw])) for draw in draws]
    low, high = np.percentile(means, [2.5, 97.5])
    flat = np.concatenate(each)
    return f"{flat.mean():.3f} ({low:.3f} .. {high:.3f}), {len(flat)}"


def _of(kind: str, alone: bool, value: Callable[[dict[str, Any]], float]) -> Values:
    """Return a figure of the children, the small children or the adults of the worlds with or without an adult."""

    def chosen(person: dict[str, Any]) -> bool:
        child = person["years"] is not None
        return child == (kind != "adult") and (kind != "small child" or person["stature"] < _CHILD_M)

    def values(world: dict[str, Any]) -> list[float]:
        if (world["name"] in _ALONE) != alone:
            return []
        people = [p for p in world["people"] if chosen(p) and p["found"] is not None]
        return [v for v in map(value, people) if not np.isnan(v)]

    return values


def _error(name: str) -> Callable[[dict[str, Any]], float]:
    return lambda person: abs(person["found"][name] / person[name] - 1)


def _taken_for_child(person: dict[str, Any]) -> float:
    return float(person["found"]["age"] is not None and person["found"]["age"]["years"] is not None)


def _within_sigma(person: dict[str, Any]) -> float:
    age = person["found"]["age"]
    if age is None:
        return np.nan
    return float(abs(np.log(person["found"]["stature"] / person["stature"])) <= age["stature_sigma"])


def _years_error(person: dict[str, Any]) -> float:
    return abs(person["found"]["age"]["years"] - person["years"]) if _taken_for_child(person) else np.nan


_FIGURES: dict[str, Values] = {}
for _alone in (False, True):
    _where = "alone" if _alone else "with an adult"
    for _kind in ("child", "small child"):
        _FIGURES |= {
            f"{_kind} {_where}: error of stature": _of(_kind, _alone, _error("stature")),
            f"{_kind} {_where}: error of distance": _of(_kind, _alone, _error("depth")),
            f"{_kind} {_where}: taken for a child": _of(_kind, _alone, _taken_for_child),
            f"{_kind} {_where}: stature within its stated spread": _of(_kind, _alone, _within_sigma),
        }
    _FIGURES[f"child {_where}: error of age, years"] = _of("child", _alone, _years_error)
_FIGURES |= {
    "adult with a child: error of stature": _of("adult", False, _error("stature")),
    "adult with a child: error of distance": _of("adult", False, _error("depth")),
    "adult with a child: taken for a child": _of("adult", False, _taken_for_child),
}


if __name__ == "__main__":
    raise SystemExit(main())
