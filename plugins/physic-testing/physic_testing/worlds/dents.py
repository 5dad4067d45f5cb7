"""Dents of soft blocks under people: shape, mesh and signed distance.

A soft block gives way where somebody lies in it. Beside the body its top rises with a bounded
slope, so that the dent is a little wider than the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from physic_core.geometry.rays import RayCaster
from physic_testing.worlds.reproducible_math import apply, dot, norm
from physic_testing.worlds.solids import BOX_QUADS, LEVEL_GROUND, Block, SolidDistances

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from physic_core.types import FloatArray

__all__ = ["Dent", "dented_distance", "dented_mesh", "press_dents"]

_SPACING = 0.012  # m between the nodes of a dented top
_SLOPE = 0.7  # of the top beside a body
_TOP = 3  # side of a block, in the order of BOX_QUADS
_SAMPLES = 3  # sample points per node along each axis, for distances
_RANGE = 0.5  # m from the block within which distances to its dent are measured
_BELOW = 0.05  # m below the deepest dent, away from people


@dataclass(frozen=True, eq=False)
class Dent:
    """Dent of one block.

    Attributes:
        block: index of the block.
        depth: (R, C) m below the undented top, at evenly spaced nodes along the block's x (rows)
            and z (columns), from edge to edge.
    """

    block: int
    depth: FloatArray


def press_dents(
    blocks: Sequence[Block], vertices: FloatArray, faces: NDArray[np.int64]
) -> tuple[Dent, ...]:
    """Return the dents of all soft blocks under people with vertices (N, V, 3) and faces (F, 3);
    room frame.
    """
    found = ((i, _depth(block, vertices, faces)) for i, block in enumerate(blocks) if block.soft)
    return tuple(Dent(i, depth) for i, depth in found if depth.any())


def dented_mesh(
    block: Block, depth: FloatArray
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Return vertices (V, 3) in the room frame, faces (F, 3) and the side (F,) of each, of a dented
    block.
    """
    rows, columns = depth.shape
    x, z = _nodes(block, depth.shape)
    half = block.half[1]
    top = np.stack([np.repeat(x, columns), half - depth.reshape(-1), np.tile(z, rows)], axis=1)
    i, j = (index.reshape(-1) for index in np.mgrid[: rows - 1, : columns - 1])
    first = i * columns + j
    quads = [np.stack([first, first + 1, first + columns + 1, first + columns], axis=1)]
    sides = [_TOP]
    vertices = [top]
    count = len(top)
    index = np.arange(rows * columns).reshape(rows, columns)
    # Sides from below up to the dented edge, seen from outside; the bottom as one quad.
    for side, edge in ((0, index[0]), (1, index[-1, ::-1]), (4, index[::-1, 0]), (5, index[:, -1])):
        low = top[edge] * (1, 0, 1) - (0, half, 0)
        lower = np.arange(len(edge)) + count
        upper = edge
        vertices.append(low)
        count += len(low)
        quads.append(np.stack([lower[:-1], lower[1:], upper[1:], upper[:-1]], axis=1))
        sides.append(side)
    bottom = Block((0, 0, 0), block.half).corners()
    vertices.append(bottom)
    quads.append(BOX_QUADS[2:3] + count)
    sides.append(2)
    faces = np.concatenate(
        [np.stack([q[:, [0, 1, 2]], q[:, [0, 2, 3]]], axis=1).reshape(-1, 3) for q in quads]
    )
    of_face = np.repeat(sides, [2 * len(q) for q in quads])
    found: FloatArray = apply(block.rotation, np.concatenate(vertices)) + np.array(block.centre)
    return found, faces, of_face


def dented_distance(block: Block, depth: FloatArray, points: FloatArray) -> FloatArray:
    """Return the signed distance (n,) of points (n, 3) to a block with a dent (R, C), negative
    inside.

    It is exact to about a millimetre within half a metre of the block.
    """
    from scipy.spatial import cKDTree

    local = block.to_local(points)
    half = np.array(block.half)
    distance: FloatArray = SolidDistances((Block((0, 0, 0), block.half),), LEVEL_GROUND).distances(
        local
    )[0]
    near = np.flatnonzero(distance < _RANGE)
    if not len(near):
        return distance
    apart = np.full(len(near), np.inf)
    for samples, normals, spacing in _surface_samples(block, depth):
        _, index = cKDTree(samples).query(local[near])
        offset = local[near] - samples[index]
        along = dot(offset, normals[index])
        beside = np.maximum(norm(offset - along[:, None] * normals[index]) - spacing, 0)
        apart = np.minimum(apart, np.sqrt(along * along + beside * beside))
    within = (np.abs(local[near]) < half).all(axis=1) & (
        local[near][:, 1] < half[1] - _depth_at(block, depth, local[near])
    )
    distance[near] = np.where(within, -apart, apart)
    return distance


def _surface_samples(block: Block, depth: FloatArray) -> list[tuple[FloatArray, FloatArray, float]]:
    """Return points (n, 3) on the dented top and on each side, their normals and half spacing, in
    block axes.
    """
    half = np.array(block.half)
    counts = [_SAMPLES * (size - 1) + 1 for size in depth.shape]
    x, z = (np.linspace(-end, end, count) for end, count in zip(half[[0, 2]], counts, strict=True))
    flat = np.stack(
        [np.repeat(x, counts[1]), np.zeros(counts[0] * counts[1]), np.tile(z, counts[0])], axis=1
    )
    height = (half[1] - _depth_at(block, depth, flat)).reshape(counts)
    steps = x[1] - x[0], z[1] - z[0]
    rise_x, rise_z = np.gradient(height, *steps)
    normal = np.stack([-rise_x, np.ones_like(height), -rise_z], axis=-1).reshape(-1, 3)
    flat[:, 1] = height.reshape(-1)
    found: list[tuple[FloatArray, FloatArray, float]] = [
        (flat, normal / norm(normal)[:, None], 0.75 * float(max(steps)))
    ]
    index = np.arange(len(flat)).reshape(counts)
    levels = np.linspace(0, 1, max(2, int(2 * half[1] / _SPACING)))[:, None, None]
    for outwards, edge in (
        ((-1, 0, 0), index[0]),
        ((1, 0, 0), index[-1]),
        ((0, 0, -1), index[:, 0]),
        ((0, 0, 1), index[:, -1]),
    ):
        upper = flat[edge[::_SAMPLES]]
        lower = upper * (1, 0, 1) - (0, half[1], 0)
        side = (lower + levels * (upper - lower)).reshape(-1, 3)
        found.append(
            (side, np.tile(np.array(outwards, np.float64), (len(side), 1)), 0.75 * _SPACING)
        )
    return found


def _depth_at(block: Block, depth: FloatArray, local: FloatArray) -> FloatArray:
    """Return the depth (n,) of a dent (R, C) under points (n, 3) in block axes, interpolated
    between the nodes.
    """
    size = np.array(depth.shape) - 1
    half = np.array(block.half)[[0, 2]]
    place = np.clip((local[:, [0, 2]] / half + 1) / 2, 0, 1) * size
    first = np.minimum(place.astype(np.int64), size - 1)
    (i, j), (a, b) = first.T, (place - first).T
    low = depth[i, j] * (1 - a) + depth[i + 1, j] * a
    high = depth[i, j + 1] * (1 - a) + depth[i + 1, j + 1] * a
    found: FloatArray = low * (1 - b) + high * b
    return found


def _depth(block: Block, vertices: FloatArray, faces: NDArray[np.int64]) -> FloatArray:
    """Return the dent (R, C) of a soft block under people."""
    from scipy.ndimage import grey_dilation

    half = np.array(block.half)
    shape = tuple(max(2, int(2 * half[axis] / _SPACING) + 1) for axis in (0, 2))
    x, z = _nodes(block, (shape[0], shape[1]))
    start = 2 * half[1] - block.soft - _BELOW
    below = np.stack(
        [
            np.repeat(x, shape[1]),
            np.full(shape[0] * shape[1], start - half[1]),
            np.tile(z, shape[0]),
        ],
        axis=1,
    )
    depth = np.zeros(len(below))
    for person in vertices:
        hits = RayCaster(block.to_local(person), faces).first(
            below, np.tile([0.0, 1.0, 0.0], (len(below), 1))
        )
        depth = np.maximum(depth, block.soft + _BELOW - hits.distance)
    steps = (x[1] - x[0]), (z[1] - z[0])
    # Fingers are thinner than the grid is wide: every vertex presses the four nodes around it.
    for person in vertices:
        local = block.to_local(person)
        deep = local[
            (np.abs(local[:, [0, 2]]) < half[[0, 2]]).all(axis=1) & (local[:, 1] < half[1])
        ]
        deep = deep[deep[:, 1] > half[1] - block.soft - _BELOW]
        i, j = (
            ((deep[:, axis] + half[axis]) / step).astype(np.int64)
            for axis, step in zip((0, 2), steps, strict=True)
        )
        for row, column in ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)):
            node = np.minimum(row, shape[0] - 1) * shape[1] + np.minimum(column, shape[1] - 1)
            np.maximum.at(depth, node, half[1] - deep[:, 1])
    reach = [int(np.ceil(depth.max() / _SLOPE / step)) for step in steps]
    i, j = np.mgrid[-reach[0] : reach[0] + 1, -reach[1] : reach[1] + 1]
    cone = -_SLOPE * np.sqrt((i * steps[0]) ** 2 + (j * steps[1]) ** 2)
    widened: FloatArray = grey_dilation(depth.reshape(shape), structure=cone, mode="nearest")
    return np.maximum(widened, 0)


def _nodes(block: Block, shape: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Return the x (R,) and z (C,) of a dent's nodes in block axes."""
    return np.linspace(-block.half[0], block.half[0], shape[0]), np.linspace(
        -block.half[2], block.half[2], shape[1]
    )
