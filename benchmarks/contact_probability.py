"""Fit the constants of contact with skin in ``physic_core.engine.contact.probability`` by maximum likelihood.

    python benchmarks/contact_probability.py --worlds 20 --seed 901 --people-worlds 10 --people-seed 910

runs the engine on worlds of the benchmark's contact actions, and on worlds of two people who touch each other. It
prints the constants of each kind of skin, with the number of vertices. Report the calibration on other seeds. Needs the
plugins physic-testing and physic-mock; a world takes about ten seconds.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import defaultdict
from dataclasses import dataclass
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
from physic_core.pipeline import solution
from physic_core.pipeline.optimise import run_engine
from physic_core.pipeline.stage_runner import StageRunner
from physic_testing.bench.run_worlds import _pipeline_and_body
from physic_testing.bench.world_evidence import WorldCase, benchmark_cases, estimate_evidence
from physic_testing.worlds import benchmark_worlds, build_world

PEOPLE = ("hug", "hand_on_shoulder", "hold_hands", "back_to_back", "child_on_lap", "sit_side_by_side")
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


def main() -> None:
    """Collect the vertices of all worlds, and print the constants."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("worlds", 20), ("seed", 901), ("people-worlds", 10), ("people-seed", 910)):
        parser.add_argument(f"--{name}", type=int, default=default)
    given = parser.parse_args()
    pairs = benchmark_worlds(given.people_worlds, given.people_seed, PEOPLE) if given.people_worlds else ()
    cases = [
        *(benchmark_cases(given.worlds, given.seed, SIZE, contact=True) if given.worlds else ()),
        *(WorldCase(name, seed, SIZE) for name, seed in pairs),
    ]
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
