"""Count people whom ``physic scene`` adds from one photo, and those whom it has twice, on worlds with hidden people.

    python -m benchmarks.scene_hidden OUT --names group hug --seeds 31 32

Each world gives moments of two and three of its four photos. In each photo, people are hidden at random. Only matching
and cameras run; results of single photos are kept in OUT, as those of ``benchmarks.scene``.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.kept_results import kept
from benchmarks.scene import NAMES, SIZE, mock_config, world_seed
from physic_core.metrics import match_by_masks

VIEWS = 4
PHOTOS = (2, 3)
HIDDEN = (0.0, 0.3, 0.3, 0.3, 0.3, 0.5, 0.5, 0.5)
"""Probability in each drawn moment that a photo hides a person whom it shows."""


def main() -> None:
    """Print the counts of all moments."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--names", nargs="+", choices=NAMES, default=["group", "hug", "outdoor_steps"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[31, 32])
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    total: dict[str, int] = {}
    for alone, numbers, seed in _worlds(given.out, given.names, given.seeds):
        for counts in _moments(alone, numbers, np.random.default_rng(seed)):
            total = {name: total.get(name, 0) + counts.get(name, 0) for name in {**total, **counts}}
    for name, count in total.items():
        print(f"{name}: {count}")


def _worlds(out: Path, names: Sequence[str], seeds: Sequence[int]) -> Iterator[tuple[list[Any], list[list[int]], int]]:
    """Yield the results of the photos of each world, the number in the world of each of their people, and the seed."""
    from physic_scene import ScenePipeline
    from physic_testing.worlds import build_world, view_names

    with ScenePipeline(mock_config()) as scene:
        for name, given in itertools.product(names, seeds):
            seed, alone, numbers = world_seed(name, given), [], []
            for view in view_names(f"{name}+other", VIEWS):
                world = build_world(view, seed, SIZE)
                result = kept(out / f"{view}-{seed}.pkl", lambda world=world: scene.alone(world.image))  # type: ignore[misc]
                match = match_by_masks(np.stack([person.mask for person in result.people]), world.masks, min_iou=0.3)
                number = dict(zip(match.predicted.tolist(), match.truth.tolist(), strict=True))
                alone.append(result)
                numbers.append([number.get(i, -1) for i in range(len(result.people))])
            if sum(map(len, numbers)) > VIEWS:
                yield alone, numbers, seed


def _moments(alone: Sequence[Any], numbers: Sequence[list[int]], rng: np.random.Generator) -> Iterator[dict[str, int]]:
    """Yield the counts of each drawn moment of a world."""
    for count, hidden in itertools.product(PHOTOS, HIDDEN):
        results, shown = [], []
        for v in sorted(rng.choice(VIEWS, count, replace=False).tolist()):
            people = alone[v].people
            rows = [i for i in range(len(people)) if rng.random() >= hidden] or [int(rng.integers(len(people)))]
            results.append(replace(alone[v], people=tuple(people[i] for i in rows)))
            shown.append([numbers[v][i] for i in rows])
        yield _counts(results, shown)


def _counts(results: Sequence[Any], shown: Sequence[list[int]]) -> dict[str, int]:
    """Return the counts of one moment, from the results of its photos and the true numbers of their people."""
    from physic_core.body import load_body
    from physic_core.errors import InputError
    from physic_scene.people import people_of_scene
    from physic_scene.photos import ScenePhoto, choose_photos
    from physic_scene.solution import solve_scene

    model = load_body("embedded").to(dtype=torch.float64)
    photos = [ScenePhoto.of(i, str(i), result, model) for i, result in enumerate(results)]
    try:
        solved = solve_scene(choose_photos(photos), model)
    except InputError:
        return {"moments without a solution": 1}

    def true_numbers(person: Any) -> set[int]:
        where = {**person.elsewhere, **person.shown}
        return {shown[solved.photos[v].index][row] for v, row in where.items()}

    matched = len(solved.rows) + len(solved.moved)
    people = people_of_scene(solved, model)
    added = [one for one in people if one.number is not None and one.number >= matched]
    others = set().union(*(true_numbers(one) for one in people if one not in added))
    found = [number for one in added for number in true_numbers(one)]
    anywhere = set().union(*(shown[photo.index] for photo in solved.photos)) - {-1}
    return {
        "moments": 1,
        "people whom no match has": len(anywhere - others),
        "added": len(set(found) - others - {-1}),
        "added who are in the result": len(found) - len(set(found) - others),
        "added, in place of no person of the world": found.count(-1),
    }


if __name__ == "__main__":
    main()
