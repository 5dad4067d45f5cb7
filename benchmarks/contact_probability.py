"""Fit the constants of ``physic_core.engine.contact.probability`` by maximum likelihood.

    python benchmarks/contact_probability.py --worlds 20 --seed 901 --people-worlds 10 --people-seed 910
    python benchmarks/contact_probability.py --surfaces --worlds 18 --seed 5 --everyday-worlds 19 --everyday-seed 301

The first fits contact with skin, on worlds of the benchmark's contact actions and of two people who touch each other;
the second contact with floor and scene, where each person counts the same. Both print the constants, with the number
of vertices. Report the calibration on other seeds. Needs the plugins physic-testing and physic-mock; a world takes
about ten seconds.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from physic_core.configuration.model import load_config
from physic_core.engine.contact import probability
from physic_core.engine.contact.skin import own_contact_seen, own_distances, people_distances, without_shared_gap
from physic_core.engine.joint.limbs import observed_parts
from physic_core.engine.presets import PRESETS
from physic_core.geometry.visibility import vertex_normals
from physic_core.metrics.matching import match_by_masks
from physic_core.pipeline import contacts, solution
from physic_core.pipeline.optimise import run_engine
from physic_core.pipeline.stage_runner import StageRunner
from physic_testing.bench.run_worlds import _pipeline_and_body
from physic_testing.bench.world_evidence import WorldCase, benchmark_cases, estimate_evidence
from physic_testing.worlds import benchmark_worlds, build_world

PEOPLE = ("hug", "hand_on_shoulder", "hold_hands", "back_to_back", "child_on_lap", "sit_side_by_side")
SURFACES = ("FLOOR", "SCENE")
SIZE = (320, 240)
PEOPLE_RADIUS_M, OWN_RADIUS_M = 0.15, 0.08
START = (0.5, math.log(0.02), -1.0, -3.0, -3.0)
"""Log-odds, log of sigma in metres, added log-odds of unseen limbs, and the logits of the two shares."""


@dataclass
class Samples:
    """Vertices of one kind of skin: signed distance in metres, whether the limb is seen, and whether they touch."""

    distance: list[NDArray[np.float64]]
    seen: list[NDArray[np.bool_]]
    true: list[NDArray[np.bool_]]

    def add(self, distance: torch.Tensor, seen: torch.Tensor, true: NDArray[np.bool_], chosen: torch.Tensor) -> None:
        """Add the chosen vertices within the search radius."""
        rows = (chosen & torch.isfinite(distance)).numpy()
        self.distance.append(distance.double().numpy()[rows])
        self.seen.append(seen.numpy()[rows])
        self.true.append(true[rows])


def collect(case: WorldCase, samples: dict[str, Samples]) -> None:
    """Run estimators and engine on one world, and add its vertices."""
    config = load_config(preset="mock")
    plan, model, _ = _pipeline_and_body(config)
    world = build_world(case.name, case.seed, case.size)
    evidence = estimate_evidence(case, world, plan, model, None)
    with patch.object(solution, "measure_contacts", wraps=solution.measure_contacts) as measured:
        run_engine(evidence, PRESETS["default"], model, StageRunner("cpu", 4))
    problem, result = measured.call_args.args[:2]
    body, vertices = problem.model, result.vertices
    normals, part = vertex_normals(vertices, body.faces), body.part_of_vertex
    people = people_distances(vertices, normals, body.outer, PEOPLE_RADIUS_M)
    rest = body(*body.zero_pose()).vertices[0]
    own = own_distances(vertices, normals, body.outer, part, rest, OWN_RADIUS_M)
    seen = observed_parts(body.part_names, problem.observed)[:, part]
    hands = torch.tensor([name.endswith("hand") for name in body.part_names])[part]
    shared, seen_on_own = without_shared_gap(people, part), own_contact_seen(seen, hands, own.vertex)
    found = match_by_masks(evidence.people.masks, world.masks, min_iou=0.3)
    for row, true in zip(found.predicted, found.truth, strict=True):
        hand = hands | hands[own.vertex[row]]
        touches_own = world.touched_own_part[true] >= 0
        samples["PERSON"].add(shared[row], seen[row], world.touched_person[true] >= 0, body.outer)
        samples["OWN_HAND"].add(own.distance[row], seen_on_own[row], touches_own, body.outer & hand)
        samples["SELF"].add(own.distance[row], seen_on_own[row], touches_own, body.outer & ~hand)


def fit(samples: Samples) -> tuple[probability.SurfaceError, float]:
    """Return the most likely constants, and the mean negative log-likelihood of a vertex."""
    distance, seen = (torch.from_numpy(np.concatenate(x)) for x in (samples.distance, samples.seen))
    true = torch.from_numpy(np.concatenate(samples.true))
    kind, settings = torch.zeros(len(distance), dtype=torch.int64), PRESETS["default"].contact

    def constants(x: Any) -> probability.SurfaceError:
        shares = 1 / (1 + np.exp(-np.asarray(x[3:])))
        return probability.SurfaceError(float(x[0]), math.exp(x[1]), float(x[2]), *map(float, shares))

    def loss(x: Any) -> float:
        with patch.object(probability, "SURFACES", (constants(x),)):
            p = probability.contact_probability(distance, kind, seen, None, settings)
        # The last summand keeps the effect of visibility finite where all limbs are seen.
        return float(-torch.log(torch.where(true, p, 1 - p)).mean()) + 1e-4 * float(x[2]) ** 2

    best = minimize(loss, START, method="Nelder-Mead", options={"maxiter": 1200, "xatol": 1e-3, "fatol": 1e-7})
    return constants(best.x), float(best.fun)


@dataclass(frozen=True)
class SurfaceSamples:
    """Vertices of people near floor and scene, as :func:`contact_probability` gets them, (n,) each.

    Attributes:
        distance: signed, metres.
        kind: of the surface.
        seen: whether the photo shows the limb.
        prior: of the contact prior.
        facing: cosine between skin and surface; NaN for hands and feet, and for surfaces without normals.
        true: whether the vertex touches floor or scene.
        weight: so that each person counts the same.
    """

    distance: torch.Tensor
    kind: torch.Tensor
    seen: torch.Tensor
    prior: torch.Tensor
    facing: torch.Tensor
    true: torch.Tensor
    weight: torch.Tensor


def collect_surfaces(case: WorldCase) -> list[SurfaceSamples]:
    """Run estimators and engine on one world, and return the vertices of each person."""
    plan, model, _ = _pipeline_and_body(load_config(preset="mock"))
    world = build_world(case.name, case.seed, case.size)
    evidence = estimate_evidence(case, world, plan, model, None)
    with (
        patch.object(contacts, "contact_probability", wraps=contacts.contact_probability) as likely,
        patch.object(contacts, "facing_probability", wraps=contacts.facing_probability) as faced,
    ):
        run_engine(evidence, PRESETS["default"], model, StageRunner("cpu", 4))
    distance, kind, seen, prior, _ = likely.call_args_list[0].args  # the first is that of scene and floor
    thin = torch.tensor([name.endswith(("hand", "foot")) for name in model.part_names])[model.part_of_vertex]
    facing = torch.where(thin, torch.nan, faced.call_args.args[0])
    found = match_by_masks(evidence.people.masks, world.masks, min_iou=0.3)
    people = []
    for row, true in zip(found.predicted, found.truth, strict=True):
        near = model.outer & torch.isfinite(distance[row])
        weight = torch.full((int(near.sum()),), 1 / max(1, int(near.sum())), dtype=torch.float64)
        values = (one[row][near] for one in (distance, kind, seen, prior, facing))
        people.append(SurfaceSamples(*values, torch.from_numpy(world.contact[true])[near], weight))
    return people


def fit_surfaces(people: Sequence[SurfaceSamples]) -> tuple[list[probability.SurfaceError], float, float, float]:
    """Return the most likely constants of floor and scenes, those of facing skin, and the mean loss."""
    every = SurfaceSamples(*(torch.cat([getattr(one, f.name) for one in people]) for f in fields(SurfaceSamples)))
    settings = PRESETS["default"].contact
    start = [number for error in probability.SURFACES[: len(SURFACES)] for number in to_numbers(error)]
    start += [probability.FACING, math.log(probability.FACING_SLOPE)]

    def loss(x: NDArray[np.float64]) -> float:
        errors = [to_error(x[7 * k : 7 * k + 7]) for k in range(len(SURFACES))]
        with (
            patch.object(probability, "SURFACES", (*errors, *probability.SURFACES[len(SURFACES) :])),
            patch.object(probability, "FACING", float(x[-2])),
            patch.object(probability, "FACING_SLOPE", math.exp(x[-1])),
        ):
            p = probability.contact_probability(every.distance, every.kind, every.seen, every.prior, settings)
            p = (p * probability.facing_probability(every.facing)).clamp(1e-6, 1 - 1e-6)
        each = -torch.log(torch.where(every.true, p, 1 - p)) * every.weight
        # Few people touch with limbs that the photo does not show: their constants stay near those of the others.
        apart = sum(x[7 * k + 2] ** 2 + (x[7 * k + 4] - x[7 * k + 3]) ** 2 for k in range(len(SURFACES)))
        shares = sum(x[7 * k + 3] ** 2 for k in range(len(SURFACES)))
        return float(each.sum() / every.weight.sum()) + 1e-3 * float(apart) + 1e-4 * float(shares)

    best = minimize(loss, start, method="L-BFGS-B", options={"maxiter": 80})
    errors = [to_error(best.x[7 * k : 7 * k + 7]) for k in range(len(SURFACES))]
    return errors, float(best.x[-2]), math.exp(best.x[-1]), float(best.fun)


def to_numbers(error: probability.SurfaceError) -> list[float]:
    """Return the constants of a surface as unbounded numbers; the weight of the prior stays at least 0."""
    a, sigma, unseen, share, unseen_share, weight, offset = astuple(error)
    return [
        a,
        math.log(sigma),
        unseen,
        math.log(share / (1 - share)),
        math.log(unseen_share / (1 - unseen_share)),
        weight,
        offset,
    ]


def to_error(x: NDArray[np.float64]) -> probability.SurfaceError:
    """Return the constants of :func:`to_numbers`."""
    shares = (1 / (1 + math.exp(-v)) for v in x[3:5])
    return probability.SurfaceError(
        float(x[0]), math.exp(x[1]), float(x[2]), *shares, max(0.0, float(x[5])), float(x[6])
    )


def print_surfaces(cases: Sequence[WorldCase]) -> None:
    """Fit floor and scene on some worlds, and print the constants."""
    people = []
    for number, case in enumerate(cases, 1):
        people += collect_surfaces(case)
        print(f"[{number}/{len(cases)}] {case.title}", file=sys.stderr, flush=True)
    errors, facing, slope, loss = fit_surfaces(people)
    for name, error in zip(SURFACES, errors, strict=True):
        print(f"{name} = SurfaceError({', '.join(f'{value:.3f}' for value in astuple(error))})")
    count = sum(len(one.true) for one in people)
    print(
        f"FACING = {facing:.3f}, FACING_SLOPE = {slope:.2f}  # {len(people)} people, {count} vertices, loss {loss:.4f}"
    )


def main() -> None:
    """Collect the vertices of all worlds, and print the constants."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--surfaces", action="store_true", help="fit floor and scene instead of skin")
    numbers = {"worlds": 20, "seed": 901, "everyday-worlds": 0, "everyday-seed": 301}
    for name, default in (numbers | {"people-worlds": 10, "people-seed": 910}).items():
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    cases = [*(benchmark_cases(given.worlds, given.seed, SIZE, "contact") if given.worlds else ())]
    if given.everyday_worlds:
        cases += benchmark_cases(given.everyday_worlds, given.everyday_seed, SIZE)
    if given.surfaces:
        print_surfaces(cases)
        return
    pairs = benchmark_worlds(given.people_worlds, given.people_seed, PEOPLE) if given.people_worlds else ()
    cases += [WorldCase(name, seed, SIZE) for name, seed in pairs]
    samples: dict[str, Samples] = defaultdict(lambda: Samples([], [], []))
    for number, case in enumerate(cases, 1):
        collect(case, samples)
        print(f"[{number}/{len(cases)}] {case.title}", file=sys.stderr, flush=True)
    for name, each in samples.items():
        if not any(map(np.any, each.true)):
            print(f"{name}: no contact in these worlds")
            continue
        error, loss = fit(each)
        numbers = ", ".join(f"{value:.3f}" for value in vars(error).values())
        count, touching = (sum(map(len, each.true)), sum(int(x.sum()) for x in each.true))
        print(f"{name} = SurfaceError({numbers})  # {count} vertices, {touching} in contact, loss {loss:.4f}")


if __name__ == "__main__":
    main()
