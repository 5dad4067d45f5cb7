"""Closed convex collision meshes of a scene: flat patches of its surface, thickened away from the
camera.

Physics engines collide with the convex hull of a mesh, so that a room as one mesh would be a solid
block. The pixels are divided like a quadtree until the surface in each square is flat; each patch
with its thickness is then nearly convex, and its hull is the collision shape.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from physic_core.geometry import transform_points, vertex_normals
from physic_export.humanoid import convex_hull
from physic_visual.scene_mesh import mesh_scene, scene_reach

if TYPE_CHECKING:
    from physic_core.types import Float64Array, Int64Array, Reconstruction
    from physic_export.humanoid import Segment


MEET_M = 0.02
"""Distance of parts of two people below which their shapes, which are simpler, may overlap,
metres.
"""

THICKNESS_M = 0.1
THINNEST_M = 0.01
"""Depth of a tile behind the surface, where only people are known, and the least, where a person is
right behind it.
"""

FLAT_M = 0.02
FLAT_SHARE = 0.01
"""Maximum distance of a patch's points from its plane: in metres, and as a share of its depth if
that is more.
"""

STEP_RIM_M = 0.02
"""Width of a step around the foot that stands on it."""

PRESSED_M = 0.002
"""Depth of a tile in a body that a simulator resolves without a push that is felt."""

MIN_FILLED = 0.8
"""Minimum share of a square that the surface covers, so that no tile spans a hole or an edge in
depth.
"""

FLOOR_M = 0.04
"""Points lower than this over the floor are the floor, which is an infinite plane of its own."""

_MAX_VERTICES = 20_000
_LARGEST = 32


@dataclass(frozen=True)
class Tile:
    """Closed convex mesh, counter-clockwise seen from outside, in the camera frame.

    Attributes:
        vertices: (V, 3) metres.
        faces: (F, 3).
        color: (3,) mean sRGB in 0-1.
    """

    vertices: Float64Array
    faces: Int64Array
    color: Float64Array


def convex_tiles(result: Reconstruction) -> list[Tile]:
    """Return the tiles of the scene above the floor."""
    surface = mesh_scene(result.scene, scene_reach(result), _MAX_VERTICES)
    if not len(surface.faces):
        return []
    points = surface.vertices.astype(np.float64)
    # row and column of the grid square that each face lies in
    cells = surface.pixels[surface.faces].min(1)[:, ::-1] // surface.stride
    colors = result.scene.colors[surface.pixels[:, 1], surface.pixels[:, 0]] / 255
    floor = result.scene.floor
    heights = np.full(len(points), np.inf)
    if floor is not None:
        heights = points @ np.asarray(floor.normal, np.float64) + floor.offset
    raised = np.flatnonzero(heights[surface.faces].max(1) >= FLOOR_M)
    skin, normals = _vertices_and_normals(result)
    tree = cKDTree(skin)
    tiles = (
        _thicken(points[patch], colors[patch].mean(0), skin, normals, tree)
        for square in _top_squares(cells, raised, _LARGEST)
        for patch in _flat_patches(square, _LARGEST, cells, surface.faces, points)
    )
    return [tile for tile in tiles if tile is not None]


def step_under(foot: Float64Array, to_camera: Float64Array) -> Tile:
    """Return a flat tile under a foot.

    Args:
        foot: (n, 3) vertices, z up.
        to_camera: (4, 4) from that frame.
    """
    low = foot.min(0) - STEP_RIM_M
    high = foot.max(0) + STEP_RIM_M
    top = foot[:, 2].min()
    corners = itertools.product(
        (low[0], high[0]), (low[1], high[1]), (float(top) - THICKNESS_M, float(top))
    )
    hull = convex_hull(transform_points(to_camera, np.array(list(corners))))
    return Tile(*hull, np.full(3, 0.5))


def tiles_without(tiles: Sequence[Tile], bodies: Sequence[Float64Array]) -> list[Tile]:
    """Return the tiles that reach at most PRESSED_M into convex bodies (n, 3) of the camera frame.

    Points of either are sought in the other: a tile can be smaller than a body.
    """
    hulls = [(points, ConvexHull(points).equations) for points in bodies]
    free_tiles = []
    for tile in tiles:
        facets = ConvexHull(tile.vertices).equations
        points = np.concatenate(
            [tile.vertices, tile.vertices[tile.faces].mean(1), tile.vertices.mean(0)[None]]
        )
        low = points.min(0)
        high = points.max(0)
        near = [
            (body, planes)
            for body, planes in hulls
            if (body.max(0) > low).all() and (body.min(0) < high).all()
        ]
        if all(
            max(_depth_inside(points, planes), _depth_inside(body, facets)) <= PRESSED_M
            for body, planes in near
        ):
            free_tiles.append(tile)
    return free_tiles


def overlapping_bodies(
    one: Sequence[Float64Array], other: Sequence[Float64Array]
) -> list[tuple[int, int]]:
    """Return the pairs of convex bodies (n, 3), of one list and of another, that overlap or are
    less than MEET_M apart.
    """
    facets = [
        [ConvexHull(points).equations if len(points) > 3 else None for points in bodies]
        for bodies in (one, other)
    ]
    pairs = []
    for first, points in enumerate(one):
        for second, others in enumerate(other):
            mine = facets[0][first]
            theirs = facets[1][second]
            if mine is None or theirs is None:
                continue
            apart = np.maximum(points.min(0) - others.max(0), others.min(0) - points.max(0))
            if apart.max() > MEET_M:
                continue
            if max(_depth_inside(points, theirs), _depth_inside(others, mine)) > -MEET_M:
                pairs.append((first, second))
    return pairs


def overlapping_segments(segments: Sequence[Segment]) -> list[tuple[int, int]]:
    """Return the pairs of segments that are no neighbors, and whose hulls overlap or are less than
    MEET_M apart in the pose or in the T-pose, such as chest and upper arm.
    """
    met: set[tuple[int, int]] = set()
    for pose in ("pose", "zero_pose"):
        places: list[Float64Array] = []
        for one in segments:
            local = getattr(one, pose)
            places.append(local if one.parent < 0 else places[one.parent] @ local)
        hulls = [
            transform_points(place, one.hull[0])
            for place, one in zip(places, segments, strict=True)
        ]
        met.update(overlapping_bodies(hulls, hulls))
    return sorted((a, b) for a, b in met if a < b and segments[b].parent != a)


def _depth_inside(points: Float64Array, facets: Float64Array) -> float:
    """Return how far the deepest of points (n, 3) is behind all facets of a hull; negative if all
    are outside.
    """
    return float(-(points @ facets[:, :3].T + facets[:, 3]).max(1).min())


def _top_squares(cells: Int64Array, faces: Int64Array, side: int) -> list[Int64Array]:
    """Divide faces by the square of ``side`` cells that they lie in."""
    square = cells[faces] // side
    key = square[:, 0] * (1 << 20) + square[:, 1]
    order = np.argsort(key, kind="stable")
    return np.split(faces[order], np.flatnonzero(np.diff(key[order])) + 1)


def _flat_patches(
    inside: Int64Array,
    side: int,
    cells: Int64Array,
    faces: Int64Array,
    points: Float64Array,
) -> Iterator[Int64Array]:
    """Yield the points of the faces in one square, or of each of its four squares if they are not
    flat.
    """
    used = np.unique(faces[inside])
    filled = len(inside) / (2 * side * side)
    flat = max(FLAT_M, FLAT_SHARE * float(points[used, 2].mean()))
    if side == 1 or (filled >= MIN_FILLED and _deviation(points[used]) <= flat):
        yield used
        return
    for quarter in _top_squares(cells, inside, side // 2):
        yield from _flat_patches(quarter, side // 2, cells, faces, points)


def _plane_axis(points: Float64Array) -> Float64Array:
    """Return the unit normal (3,) of the plane through points, away from the camera."""
    centered = points - points.mean(0)
    normal: Float64Array = np.linalg.eigh(centered.T @ centered)[1][:, 0]
    return normal if normal @ points.mean(0) > 0 else -normal


def _deviation(points: Float64Array) -> float:
    centered = points - points.mean(0)
    return float(np.abs(centered @ _plane_axis(points)).max())


def _vertices_and_normals(result: Reconstruction) -> tuple[Float64Array, Float64Array]:
    """Return vertices and outward normals (n, 3) of all people with a body."""
    bodies = [np.asarray(one.vertices, np.float64) for one in result.people if one.has_body]
    faces = np.asarray(result.faces, np.int64)
    normals = [vertex_normals(body, faces) for body in bodies]
    return np.concatenate([np.zeros((0, 3)), *bodies]), np.concatenate([np.zeros((0, 3)), *normals])


def _depth_to_skin(
    points: Float64Array,
    axis: Float64Array,
    skin: Float64Array,
    normals: Float64Array,
    tree: cKDTree,
) -> float:
    """Return the distance along an axis from a patch to the skin behind it that faces it; infinite
    without such skin.

    Skin that a body presses into the patch from its front faces along the axis, and does not count.
    """
    center = points.mean(0)
    reach = float(np.linalg.norm(points - center, axis=1).max()) + THICKNESS_M
    near = np.asarray(tree.query_ball_point(center, reach), np.int64)
    near = near[(normals[near] @ axis) < 0]
    depth = (skin[near] - center) @ axis
    near = near[depth > 0]
    depth = depth[depth > 0]
    across = np.linalg.svd(axis[None])[2][1:].T
    try:
        edges = ConvexHull((points - center) @ across).equations
    except QhullError:  # all points on one line
        return math.inf
    inside = (edges[:, :2] @ ((skin[near] - center) @ across).T + edges[:, 2:]).max(
        0, initial=-math.inf
    ) < 0
    return float(depth[inside].min(initial=math.inf))


def _thicken(
    points: Float64Array,
    color: Float64Array,
    skin: Float64Array,
    normals: Float64Array,
    tree: cKDTree,
) -> Tile | None:
    """Return the convex hull of points and of the same points moved away from the camera; None if
    it is degenerate.

    Args:
        points: (P, 3) of the surface.
        color: (3,) of the tile.
        skin: (n, 3) vertices of all people, which a tile does not reach from its front.
        normals: (n, 3) of the skin, outward.
        tree: of the skin.
    """
    axis = _plane_axis(points)
    depth = min(THICKNESS_M, max(THINNEST_M, _depth_to_skin(points, axis, skin, normals, tree)))
    both = np.concatenate([points, points + depth * axis])
    try:
        return Tile(*convex_hull(both), color)
    except QhullError:  # all points on one line
        return None
