"""Nearest-point strategies against the plain search in chunks: time with set-up, and error against exact."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from torch import Tensor

from physic_core.engine.joint.problem import JointProblem
from physic_core.geometry.neighbors import Nearest, NearestScene, Strategy, near_boxes

__all__ = ["errors_mm", "nearest_rows"]

Rounds = Callable[[Mapping[str, Callable[[], None]], int], dict[str, tuple[float, float]]]

_RADIUS_M = 0.15
_WANDER_M = 0.6  # as the engine gathers the scene: people may move so far
_SAMPLE = 64  # vertices that the plain search is timed on
_CHECKED = 512  # vertices whose answers are compared


def nearest_rows(
    problem: JointProblem, steps: int, repeats: int, rounds: Rounds
) -> list[tuple[str, float, float, dict[str, float]]]:
    """Time each strategy over ``steps`` queries of all vertices of all people, moved a little from step to step.

    Args:
        problem: its scene points and its people.
        steps: queries.
        repeats: rounds.
        rounds: times several things in turns.

    Returns:
        Name, seconds, ratio to the plain search, and numbers: errors in mm against exact.
    """
    points, normals = problem.scene_points, problem.scene_normals
    vertices = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0).vertices
    some = vertices.reshape(-1, 3)[:: -(-vertices[..., 0].numel() // _SAMPLE)]
    whole = NearestScene(points, normals, _RADIUS_M, "brute")
    names: dict[str, Strategy] = {
        "k-d tree, bounded (default)": "kdtree",
        "grid of 128^3 nodes, each searched when first met": "grid",
    }

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
        rows.append((name, seconds, ratio / more, errors_mm(got, exact)))
    return rows


def errors_mm(got: Nearest, exact: Nearest) -> dict[str, float]:
    """How far the points that were found lie beyond the nearest ones, mm, and the share of answers that one lacks."""
    both = got.found & exact.found
    excess = 1e3 * (got.distance - exact.distance)[both].double()
    return {
        "mean error mm": round(float(excess.mean()), 4) if both.any() else 0.0,
        "largest mm": round(float(excess.amax()), 4) if both.any() else 0.0,
        "missed %": round(100 * float((got.found != exact.found).double().mean()), 3),
    }


def _ignore(_: object) -> None:
    """For its time alone."""


def _gather(points: Tensor, normals: Tensor, vertices: Tensor, strategy: Strategy) -> NearestScene:
    """The scene round the people, as the engine searches it."""
    keep = near_boxes(points, vertices, _RADIUS_M + _WANDER_M)
    return NearestScene(points[keep], normals[keep], _RADIUS_M, strategy)
