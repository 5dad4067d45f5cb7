"""Solid things: their signed distance against a plain twin and trimesh, its gradient, and their
mesh.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh

from physic_testing.worlds.solids import (
    LEVEL_GROUND,
    Block,
    Ground,
    SolidDistances,
    blocks_mesh,
    signed_distance,
)

if TYPE_CHECKING:
    from physic_core.types import FloatArray

_BLOCKS = (
    Block((0.3, 0.5, -0.2), (0.4, 0.5, 0.2), yaw=0.4),
    Block((-1.0, 0.6, 0.5), (0.3, 0.6, 0.1), yaw=-0.8, pitch=0.3),
    Block((0.5, 1.1, 0.1), (0.2, 0.3, 0.4), yaw=1.1),
)


def _points(count: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform((-2, -0.3, -1.5), (2, 2, 1.5), (count, 3))


def _plain(point: FloatArray, blocks: tuple[Block, ...], ground: Ground) -> float:
    """One point after another, one block after another."""
    best = float(np.dot(point, ground.normal))
    for block in blocks:
        axes = block.rotation
        local = [float(np.dot(point - np.array(block.centre), axes[:, k])) for k in range(3)]
        beyond = [abs(local[k]) - block.half[k] for k in range(3)]
        inside = max(beyond) <= 0
        best = min(best, max(beyond) if inside else sum(max(b, 0.0) ** 2 for b in beyond) ** 0.5)
    return best


def test_the_distance_is_that_of_a_slow_reference() -> None:
    ground = Ground((0.1, float(np.sqrt(1 - 0.01 - 0.04)), 0.2))
    points = _points(300)
    wanted = [_plain(point, _BLOCKS, ground) for point in points]
    assert signed_distance(points, _BLOCKS, ground) == pytest.approx(wanted, abs=1e-12)
    assert signed_distance(points, (), ground) == pytest.approx(
        points @ np.array(ground.normal), abs=1e-12
    )


def test_the_signed_distance_outside_equals_the_distance_to_the_mesh() -> None:
    points = _points(200, seed=1)
    points[:, 1] += 5  # far from the ground, with the blocks lifted too
    lifted = tuple(
        Block((b.centre[0], b.centre[1] + 5, b.centre[2]), b.half, b.yaw, pitch=b.pitch)
        for b in _BLOCKS
    )
    vertices, faces, side = blocks_mesh(lifted)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert np.bincount(side).tolist() == [2] * 18
    assert mesh.volume == pytest.approx(sum(8 * np.prod(b.half) for b in lifted))
    found = signed_distance(points, lifted, LEVEL_GROUND)
    outside = found > 0
    triangles = mesh.triangles
    wanted = [
        np.linalg.norm(
            trimesh.triangles.closest_point(triangles, np.tile(p, (len(triangles), 1))) - p, axis=1
        ).min()
        for p in points[outside]
    ]
    assert found[outside] == pytest.approx(wanted, abs=1e-9)
    parts = [trimesh.Trimesh(*blocks_mesh((block,))[:2], process=False) for block in lifted]
    behind = [
        ((points[:, None] - p.triangles_center) * p.face_normals).sum(-1).max(1) <= 0 for p in parts
    ]
    assert np.array_equal(~outside, np.any(behind, axis=0))


def test_the_gradient_is_right_inside_and_outside() -> None:
    points = _points(40, seed=2)
    step = 1e-6
    solid = SolidDistances(_BLOCKS, Ground((0.0, 0.8, 0.6)))
    assert np.array_equal(
        solid.distances(points).min(axis=0),
        signed_distance(points, _BLOCKS, Ground((0.0, 0.8, 0.6))),
    )
    for which in range(len(_BLOCKS) + 1):
        wanted = [
            (solid.distances(points + step * axis) - solid.distances(points - step * axis))[which]
            / (2 * step)
            for axis in np.eye(3)
        ]
        np.testing.assert_allclose(
            solid.normals(points, np.full(40, which)), np.stack(wanted, axis=1), atol=1e-8
        )
