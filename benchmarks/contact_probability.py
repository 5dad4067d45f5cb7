"""Fit the contact of vertices, ``physic_core/engine/contact/coefficients.json``, on synthetic
worlds.

    python -m benchmarks.contact_probability sample MAKE --seed 1 --worlds 45 --raised-worlds 35
    --people-worlds 30 python -m benchmarks.contact_probability sample CHOOSE --seed 2 --worlds 20
    --raised-worlds 15 --people-worlds 10 python -m benchmarks.contact_probability fit MAKE CHOOSE

``sample`` runs estimators and engine, and keeps the features of the vertices of each world in a
folder; an interrupted run continues. ``fit`` finds the coefficients of the columns that the file
names by maximum likelihood on one folder, and writes them with their error on another; which
vertices touch the scene is fitted on body parts that do. Each person counts the same. The worlds
have the noise of version 4, other bodies and labelled surfaces. Worlds of people whose feet are
over the ground, and of people who touch each other, are added, since both are rare.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray

from physic_bench.worlds.world_evidence import (
    WorldCase,
    benchmark_cases,
    estimate_evidence,
    noisy_config,
    with_other_bodies,
)
from physic_core.body import load_body
from physic_core.body.model import BodyModel
from physic_core.configuration.resolve import resolve
from physic_core.engine.contact.features import KINDS, feature_columns, measure_distances
from physic_core.engine.contact.partner import VertexContacts, body_contacts
from physic_core.engine.contact.parts import contact_parts, near_scene, nearness, scene_contact
from physic_core.engine.contact.probability import contact_model
from physic_core.engine.contact.problem import ContactInput, ContactResult
from physic_core.engine.contact.regions import contact_regions
from physic_core.engine.presets import DEFAULT
from physic_core.metrics import match_by_masks
from physic_core.pipeline import optimise
from physic_core.pipeline.stage_runner import StageRunner
from physic_testing.worlds import RAISED_FEET_WORLDS, World, benchmark_worlds, build_world

Array = NDArray[np.float64]
Table = tuple[Array, NDArray[np.bool_]]
"""Columns (n, C) and truth (n,)."""

COEFFICIENTS = (
    Path(__file__).parents[1] / "physic_core" / "engine" / "contact" / "coefficients.json"
)
PEOPLE = (
    "hug",
    "hand_on_shoulder",
    "hold_hands",
    "back_to_back",
    "child_on_lap",
    "sit_side_by_side",
)
SIZE = (320, 240)
RIDGE = 1e-4
"""Weight of the squared coefficients: columns that say the same share one effect."""

PART_COLUMNS = ("constant", "log odds")
SCENE = "scene"
NEAR = ("rise", "facing", "hand or foot", "of the scene", "touches")
"""Columns of vertices at the scene: as ``NearScene``, the engine's probability, and whether the
body part touches.
"""

LEAST_VERTICES = 10
"""Of a body part that truly touches."""

STATED = {
    SCENE: ("floor", "scene", "hidden"),
    "person": ("person",),
    "own body": ("self",),
    "object": ("object",),
}


def main() -> int:
    """Collect samples, or fit."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    sample = commands.add_parser("sample")
    sample.add_argument("out", type=Path)
    for name, default in {"seed": 1, "worlds": 45, "raised-worlds": 0, "people-worlds": 0}.items():
        sample.add_argument(f"--{name}", type=int, default=default)
    command = commands.add_parser("fit")
    command.add_argument("make", type=Path)
    command.add_argument("choose", type=Path)
    given = parser.parse_args()
    if given.command == "sample":
        cases = [*benchmark_cases(given.worlds, given.seed, SIZE, "both")]
        for count, names in (
            (given.raised_worlds, RAISED_FEET_WORLDS),
            (given.people_worlds, PEOPLE),
        ):
            cases += [
                WorldCase(name, seed, SIZE)
                for name, seed in benchmark_worlds(count, given.seed, names)
            ]
        collect(with_other_bodies(cases), given.out)
    else:
        fit(Samples.read(given.make), Samples.read(given.choose))
    return 0


def collect(cases: Sequence[WorldCase], out: Path) -> None:
    """Run estimators and engine on each world, and write the samples that are missing."""
    torch.set_num_threads(1)
    plan = resolve(noisy_config())
    model = load_body(plan.body_model)
    out.mkdir(parents=True, exist_ok=True)
    for number, case in enumerate(cases, 1):
        file = out / f"{case.name}-{case.seed}.npz"
        if not file.exists():
            world = build_world(case.name, case.seed, case.size)
            evidence = estimate_evidence(case, world, plan, model, None)
            torch.manual_seed(0)
            with patch.object(optimise, "solve_contact", wraps=optimise.solve_contact) as solve:
                optimise.run_engine(
                    evidence, DEFAULT, model, StageRunner("cpu", len(plan.backends))
                )
            found = match_by_masks(evidence.people.masks, world.masks, min_iou=0.3)
            pairs = list(zip(found.predicted.tolist(), found.truth.tolist(), strict=True))
            inputs = solve.call_args.args[0]
            result = optimise.solve_contact(*solve.call_args.args)
            np.savez_compressed(file, **samples_of(inputs, result, world, pairs))
        print(f"[{number}/{len(cases)}] {case.title}", file=sys.stderr, flush=True)


def samples_of(
    given: ContactInput, result: ContactResult, world: World, pairs: Sequence[tuple[int, int]]
) -> dict[str, Any]:
    """Return the arrays of one world: for each person and kind of contact columns, truth and listed
    body parts.
    """
    near = measure_distances(given, DEFAULT.contact.measure)
    outer = given.model.outer.numpy()
    finite = given.finite.tolist()
    arrays: dict[str, Any] = {
        f"names {SCENE}": np.array(NEAR),
        "pairs": np.array([pair for pair in pairs if finite[pair[0]]], np.int64).reshape(-1, 2),
    }
    at = near_scene(given, near)
    limbs = given.part("hand", "foot").expand_as(near.surface.scene)
    likely = scene_contact(given, near)[0]
    for kind, columns in feature_columns(given, near).items():
        arrays[f"names {kind}"] = np.array(list(columns))
        for row, _ in arrays["pairs"]:
            table = torch.stack([column[row] for column in columns.values()], 1).numpy()[outer]
            arrays[f"{kind} {row}"] = table.astype(np.float32)
    for row, true in arrays["pairs"]:
        touched = dict(zip(KINDS, true_contact(world, int(true)), strict=True))
        parts = torch.zeros_like(given.model.outer)
        for chosen in contact_parts(given.model).values():
            parts |= chosen & bool(touched[SCENE][chosen.numpy()].sum() >= LEAST_VERTICES)
        table = torch.stack(
            [x.float() for x in (at.rise[row], at.facing[row], limbs[row], likely[row], parts)], 1
        )
        arrays[f"{SCENE} {row}"] = table.numpy()[outer].astype(np.float32)
        arrays[f"truth {row}"] = np.stack([values[outer] for values in touched.values()])
        arrays[f"seen {row}"] = given.seen[row].numpy()[outer]
        arrays[f"parts {row}"] = np.array(
            part_samples(given.model, result, int(row), touched)
        ).reshape(-1, 2)
    return arrays


def true_contact(world: World, person: int) -> tuple[NDArray[np.bool_], ...]:
    """Return the true contact (V,) of each kind of a person."""
    touched = (world.touched_person, world.touched_own_part, world.touched_item)
    return (np.asarray(world.contact[person]), *(np.asarray(of[person]) >= 0 for of in touched))


def part_samples(
    model: BodyModel, result: ContactResult, row: int, touched: Mapping[str, NDArray[np.bool_]]
) -> list[tuple[float, float]]:
    """Return log odds and truth of each contact of a body part that is listed; true is contact of
    ten vertices.
    """
    regions = contact_regions(model)
    rows = []
    assert result.probability is not None
    index = result.partner[row]
    likely = result.probability[row]
    found = VertexContacts(index, None, torch.full_like(likely, torch.nan))
    for one in body_contacts(found, result.partners, regions):
        part = regions.region == regions.names.index(one.part)
        here = part & (index == result.partners.index(one.partner))
        surest = likely[here].topk(min(10, one.vertices)).values.mean()
        kind = next(kind for kind, names in STATED.items() if one.partner.kind in names)
        true = touched[kind][part.numpy()].sum() >= LEAST_VERTICES
        rows.append((float(torch.logit(surest.double(), 1e-6)), float(true)))
    return rows


@dataclass(frozen=True)
class Samples:
    """Samples of people, (n, ...) vertices each.

    Attributes:
        names: kind of contact -> names of the columns.
        people: per person, kind of contact -> columns and truth.
        anything: per person, truth (n,) of contact with anything.
        seen: per person, (n,) whether the photo shows the limb.
        parts: (m, 2) of all people: log odds of a listed body part, and truth.
        worlds: number of worlds.
    """

    names: Mapping[str, Sequence[str]]
    people: Sequence[Mapping[str, Table]]
    anything: Sequence[NDArray[np.bool_]]
    seen: Sequence[NDArray[np.bool_]]
    parts: Array
    worlds: int

    @staticmethod
    def read(folder: Path) -> Samples:
        """Read all samples of a folder."""
        names: dict[str, Sequence[str]] = {}
        people = []
        anything = []
        seen = []
        parts = []
        files = sorted(folder.glob("*.npz"))
        for file in files:
            with np.load(file, allow_pickle=False) as stored:
                here = [kind for kind in KINDS if f"names {kind}" in stored]
                names |= {kind: stored[f"names {kind}"].tolist() for kind in here}
                for row, _ in stored["pairs"]:
                    truth = stored[f"truth {row}"]
                    tables = {
                        kind: (stored[f"{kind} {row}"], truth[KINDS.index(kind)]) for kind in here
                    }
                    people.append(tables)
                    anything.append(truth.any(0))
                    seen.append(stored[f"seen {row}"])
                    parts.append(stored[f"parts {row}"])
        return Samples(names, people, anything, seen, np.concatenate(parts), len(files))

    def tables(self, kind: str, names: Sequence[str]) -> list[Table]:
        """Return chosen columns and truth of each person with contact of a kind."""
        columns = [self.names[kind].index(name) for name in names]
        return [
            (one[kind][0][:, columns].astype(np.float64), one[kind][1])
            for one in self.people
            if kind in one
        ]


def logistic(tables: Sequence[Table]) -> Array:
    """Return the most likely coefficients, by Newton's method; the first column is the constant."""
    X = np.concatenate([x for x, _ in tables])
    y = np.concatenate([y for _, y in tables]).astype(np.float64)
    found = np.zeros(X.shape[1])
    penalty = RIDGE * len(y) * np.r_[0.0, np.ones(X.shape[1] - 1)]
    for _ in range(40):
        p = 1 / (1 + np.exp(-X @ found))
        slope = X.T @ (p - y) + penalty * found
        step = np.linalg.solve((X * (p * (1 - p))[:, None]).T @ X + np.diag(penalty + 1e-9), slope)
        found -= step * min(1.0, 3 / np.abs(step).max())
        if np.abs(step).max() < 1e-5:
            break
    return found


def probability(x: Array, coefficients: Array) -> Array:
    """Return the probability (n,) of columns (n, C)."""
    answer: Array = 1 / (1 + np.exp(-x @ coefficients))
    return answer


def loss(tables: Sequence[Table], coefficients: Array) -> float:
    """Return the log loss of a vertex, mean over people."""
    each = []
    for x, y in tables:
        p = probability(x, coefficients).clip(1e-9, 1 - 1e-9)
        each.append(-np.log(np.where(y, p, 1 - p)).mean())
    return float(np.mean(each))


def calibration_error(p: Array, true: NDArray[np.bool_]) -> float:
    """Return the expected calibration error in ten bins."""
    bins = np.minimum((p * 10).astype(int), 9)
    return float(np.abs(np.bincount(bins, p - true, 10)).sum() / max(1, len(p)))


def fit(make: Samples, choose: Samples) -> None:
    """Fit the columns of the file, and write the file."""
    model = contact_model()
    vertex = {kind: dict.fromkeys(values, 0.0) for kind, values in model.vertex.items()}
    widths = fit_nearness(make)
    losses = {
        f"{SCENE}, of parts that touch": nearness_loss(list(widths.values()), touching(choose))
    }
    for kind, chosen in vertex.items():
        found = logistic(make.tables(kind, list(chosen)))
        losses[kind] = loss(choose.tables(kind, list(chosen)), found)
        vertex[kind] = {
            name: round(float(value), 3) for name, value in zip(chosen, found, strict=True)
        }
    likely = [anything_of(one, vertex, choose.names) for one in choose.people]
    errors = {
        name: calibration_error(
            np.concatenate([p[seen == shown] for p, seen in zip(likely, choose.seen, strict=True)]),
            np.concatenate(
                [
                    true[seen == shown]
                    for true, seen in zip(choose.anything, choose.seen, strict=True)
                ]
            ),
        )
        for name, shown in (("seen", True), ("unseen", False))
    }
    part = logistic([(part_columns(make.parts), make.parts[:, 1] > 0)])
    errors["parts"] = calibration_error(
        probability(part_columns(choose.parts), part), choose.parts[:, 1] > 0
    )
    record = {
        "made by": "benchmarks/contact_probability.py",
        "fitted on": f"{make.worlds} worlds and {len(make.people)} people of seed 1, noise 4, "
        f"other bodies",
        "held-out error": f"{choose.worlds} worlds of seed 2: log loss of a vertex "
        + ", ".join(f"{kind} {value:.4f}" for kind, value in losses.items())
        + "; calibration error of "
        + ", ".join(f"{name} {value:.3f}" for name, value in errors.items()),
        "nearness": widths,
        "vertex": vertex,
        "part": {
            name: round(float(value), 3) for name, value in zip(PART_COLUMNS, part, strict=True)
        },
    }
    COEFFICIENTS.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(record, indent=2))


def touching(samples: Samples) -> list[Table]:
    """Return rise, facing and limb of the vertices on parts that touch the scene, and truth, of
    each person.
    """
    found = []
    for columns, true in samples.tables(SCENE, NEAR):
        chosen = columns[:, NEAR.index("touches")] > 0
        found += [(columns[chosen], true[chosen])] if chosen.any() else []
    return found


def fit_nearness(make: Samples) -> dict[str, float]:
    """Return the most likely widths of contact on parts that touch the scene."""
    from scipy.optimize import minimize

    names = [f"{name}{of}" for of in ("", ", hand or foot") for name in ("far_m", "facing")]
    tables = touching(make)
    found = minimize(
        lambda widths: nearness_loss(widths, tables), [0.1, 2.0, 0.05, 0.2], method="Nelder-Mead"
    ).x
    return dict(zip(names, found.round(3).tolist(), strict=True))


def nearness_loss(widths: Sequence[float], tables: Sequence[Table]) -> float:
    """Return the log loss of the vertices of parts that touch, mean over people, by widths (4,)."""
    each = []
    for columns, true in tables:
        rise, facing, limb = torch.from_numpy(columns[:, :3]).T
        far_m, power = (torch.where(limb > 0, widths[i + 2], widths[i]) for i in range(2))
        p = nearness(rise, facing, far_m.abs(), power.abs()).numpy().clip(1e-3, 1 - 1e-3)
        each.append(-np.log(np.where(true, p, 1 - p)).mean())
    return float(np.mean(each))


def part_columns(parts: Array) -> Array:
    """Return the columns (m, 2) of ``PART_COLUMNS`` of samples of body parts."""
    return np.c_[np.ones(len(parts)), parts[:, 0]]


def anything_of(
    person: Mapping[str, Table],
    vertex: Mapping[str, Mapping[str, float]],
    names: Mapping[str, Sequence[str]],
) -> Array:
    """Return the probability (n,) of contact with anything."""
    free: Array = np.ones(len(next(iter(person.values()))[1]))
    for kind, (columns, _) in person.items():
        free = free * (1 - likelihood_of(kind, columns.astype(np.float64), vertex, names))
    return 1 - free


def likelihood_of(
    kind: str,
    columns: Array,
    vertex: Mapping[str, Mapping[str, float]],
    names: Mapping[str, Sequence[str]],
) -> Array:
    """Return the probability (n,) of one kind of contact; that with the scene is the engine's."""
    if kind == SCENE:
        return columns[:, NEAR.index("of the scene")]
    return probability(columns, np.array([vertex[kind].get(name, 0.0) for name in names[kind]]))


if __name__ == "__main__":
    sys.exit(main())
