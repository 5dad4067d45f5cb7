"""Run time and error of the nearest-point search compared with brute-force search."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from physic_core.engine.joint.problem import JointProblem
from physic_core.geometry.neighbors import Nearest, NearestPointSearch, inside_body_boxes

Rounds = Callable[[Mapping[str, Callable[[], None]], int], dict[str, tuple[float, float]]]

_RADIUS_M = 0.15
_WANDER_M = 0.6  # as the engine gathers the scene: people may move so far
_SAMPLE = 64  # vertices that the plain search is timed on
_CHECKED = 512  # vertices whose answers are compared
_PAIRS = 4_000_000  # distances per chunk: 32 MB in float64


class PlainSearch(NearestPointSearch):
    """Nearest-point search that compares each place with all points."""

    def lookup(self, places: Tensor, radius: float) -> tuple[Tensor, Tensor]:
        """Return the index (n,) of the nearest point to each place (n, 3), and its distance (n,)."""
        index, distance = [], []
        exact = self.points.double()
        for chunk in torch.split(places.double(), max(1, _PAIRS // len(exact))):
            # The default mode uses a matrix product and loses millimetres far from the origin.
            nearest = torch.cdist(chunk, exact, compute_mode="donot_use_mm_for_euclid_dist").min(dim=1)
            index.append(nearest.indices)
            distance.append(nearest.values)
        return torch.cat(index), torch.cat(distance).to(places.dtype)


def nearest_rows(
    problem: JointProblem, steps: int, repeats: int, rounds: Rounds
) -> list[tuple[str, float, float, dict[str, float]]]:
    """Time the search over ``steps`` queries of all vertices, which move slightly in each step.

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
    near = inside_body_boxes(points, vertices, _RADIUS_M + _WANDER_M)  # as the engine selects the scene points
    whole = PlainSearch(points, normals, _RADIUS_M)
    gathered = PlainSearch(points[near], normals[near], _RADIUS_M)

    def search() -> None:
        scene = NearestPointSearch(points[near], normals[near], _RADIUS_M)
        for k in range(steps):
            scene.query(vertices + 1e-3 * k)

    plain: dict[str, Callable[[], None]] = {
        "plain search in chunks": lambda: _ignore(whole.query(some)),
        "plain search, only of points near the people": lambda: _ignore(gathered.query(some)),
    }
    timed = rounds({**plain, "k-d tree, bounded (default)": search}, repeats)
    # The plain search costs the same for each vertex and each step.
    more = steps * vertices[..., 0].numel() / len(some)
    few = vertices.reshape(-1, 3)[:: -(-vertices[..., 0].numel() // _CHECKED)]
    exact = whole.query(few)
    rows: list[tuple[str, float, float, dict[str, float]]] = []
    for name, (seconds, ratio) in timed.items():
        if name in plain:
            rows.append((name, seconds * more, ratio, {"points": len((whole if not rows else gathered).points)}))
            continue
        got = NearestPointSearch(points[near], normals[near], _RADIUS_M).query(few)
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
