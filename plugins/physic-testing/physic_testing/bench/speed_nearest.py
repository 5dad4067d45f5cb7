"""Run time and error of nearest-point strategies compared with brute-force search."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from torch import Tensor

from physic_core.engine.joint.problem import JointProblem
from physic_core.geometry.neighbors import Nearest, NearestPointSearch, Strategy, inside_body_boxes

__all__ = ["nearest_errors_mm", "nearest_rows"]

Rounds = Callable[[Mapping[str, Callable[[], None]], int], dict[str, tuple[float, float]]]

_RADIUS_M = 0.15
_WANDER_M = 0.6  # as the engine gathers the scene: people may move so far
_SAMPLE = 64  # vertices that the plain search is timed on
_CHECKED = 512  # vertices whose answers are compared


def nearest_rows(
    problem: JointProblem, steps: int, repeats: int, rounds: Rounds
) -> list[tuple[str, float, float, dict[str, float]]]:
    """Time each strategy over ``steps`` queries of all vertices, which move slightly in each step.

    Args:
        problem: provides scene points and people.
        steps: number of queries.
        repeats: number of rounds.
        rounds: function that times several functions in turns.

    Returns:
        Name, seconds, ratio to brute force, and numbers: errors in mm against brute force.
    """
    points, normals = problem.scene_points, problem.scene_normals
    vertices = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0).vertices
    some = vertices.reshape(-1, 3)[:: -(-vertices[..., 0].numel() // _SAMPLE)]
    whole = NearestPointSearch(points, normals, _RADIUS_M, "brute")
    names: dict[str, Strategy] = {"k-d tree, bounded (default)": "kdtree"}

    def search(strategy: Strategy) -> None:
        scene = _gather(points, normals, vertices, strategy)
        for k in range(steps):
            scene.query(vertices + 1e-3 * k)

    gathered = _gather(points, normals, vertices, "brute")
    plain: dict[str, Callable[[], None]] = {
        "plain search in chunks": lambda: _ignore(whole.query(some)),
        "plain search, only of points near the people": lambda: _ignore(gathered.query(some)),
    }
    timed = rounds({**plain, **{name: partial(search, strategy) for name, strategy in names.items()}}, repeats)
    # The plain search costs the same for each vertex and each step.
    more = steps * vertices[..., 0].numel() / len(some)
    few = vertices.reshape(-1, 3)[:: -(-vertices[..., 0].numel() // _CHECKED)]
    exact = whole.query(few)
    rows: list[tuple[str, float, float, dict[str, float]]] = []
    for name, (seconds, ratio) in timed.items():
        if name in plain:
            rows.append((name, seconds * more, ratio, {"points": len((whole if not rows else gathered).points)}))
            continue
        got = _gather(points, normals, vertices, names[name]).query(few)
        rows.append((name, seconds, ratio / more, nearest_errors_mm(got, exact)))
    return rows


def nearest_errors_mm(got: Nearest, exact: Nearest) -> dict[str, float]:
    """Return mean and largest error of nearest-point distances, mm, and the percentage found by one search only."""
    both = got.found & exact.found
    excess = 1e3 * (got.distance - exact.distance)[both].double()
    return {
        "mean error mm": round(float(excess.mean()), 4) if both.any() else 0.0,
        "largest mm": round(float(excess.amax()), 4) if both.any() else 0.0,
        "missed %": round(100 * float((got.found != exact.found).double().mean()), 3),
    }


def _ignore(_: object) -> None:
    """Discard a result."""


def _gather(points: Tensor, normals: Tensor, vertices: Tensor, strategy: Strategy) -> NearestPointSearch:
    """Return the scene points near the people, as the engine selects them."""
    keep = inside_body_boxes(points, vertices, _RADIUS_M + _WANDER_M)
    return NearestPointSearch(points[keep], normals[keep], _RADIUS_M, strategy)
