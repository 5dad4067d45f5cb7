"""Stand-ins of the networks, which know the truth of worlds: what is measured is all but the networks."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from physic_cameras.disk_lightglue import Features
from physic_testing import world_of
from physic_testing.worlds import build_world, view_names
from physic_testing.worlds.views import split_name

POOL = 3000


@cache
def points_of_room(name: str, seed: int, size: tuple[int, int]) -> np.ndarray:
    """(n, 3) points of the room's surfaces, room frame: the same of all views of a world."""
    found = []
    for view_name in view_names(name, 3):
        view = build_world(view_name, seed, size)
        rng = np.random.default_rng(len(found))
        rows, columns = np.nonzero(np.isfinite(view.empty_depth))
        some = rng.choice(len(rows), POOL // 3)
        pixels = np.column_stack([columns[some], rows[some]])
        depth = view.empty_depth[rows[some], columns[some]].astype(np.float64)
        camera = view.intrinsics
        local = np.column_stack([(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(pixels))])
        found.append((local * depth[:, None]) @ view.camera.rotation + view.camera.position)
    return np.concatenate(found)


class TrueMatcher:
    """Features are points of the room's surfaces; descriptors are their numbers, of which a share is wrong."""

    def __init__(self, *, noise_px: float = 0.3, outliers: float = 0.3) -> None:
        self.noise_px, self.outliers = noise_px, outliers

    def features(self, image: np.ndarray) -> Features:
        size = (image.shape[1], image.shape[0])
        world = world_of(image)
        if world is None:
            return Features(np.zeros((0, 2)), np.zeros(0, int), size)
        local = (
            points_of_room(split_name(world.name)[0], world.seed, size) - world.camera.position
        ) @ world.camera.rotation.T
        camera = world.intrinsics
        pixels = local[:, :2] / local[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        inside = (local[:, 2] > 0.1) & (pixels > 0).all(1) & (pixels < np.array(size) - 1).all(1)
        number = np.flatnonzero(inside)
        columns, rows = pixels[inside].round().astype(int).T
        number = number[np.abs(world.empty_depth[rows, columns] / local[number, 2] - 1) < 0.01]
        rng = np.random.default_rng(int(image.sum()))
        wrong = rng.random(len(number)) < self.outliers / 2
        named = np.where(wrong, rng.permutation(number), number)
        _, first = np.unique(named, return_index=True)
        seen = pixels[number] + self.noise_px * rng.standard_normal((len(number), 2))
        return Features(seen[first], named[first], size)

    def match(self, one: Features, two: Features) -> np.ndarray:
        _, first, second = np.intersect1d(one.descriptors, two.descriptors, return_indices=True)
        return np.column_stack([first, second])


class TruePoses:
    """The poses of a world at another scale and in another frame, with errors, as Depth Anything 3 returns them.

    Args:
        images: photos of the world, which the network gets reduced.
        turn_deg: errors of rotations.
        scale: unit of the network.
    """

    def __init__(self, images: list[np.ndarray], *, turn_deg: float = 1.0, scale: float = 0.2) -> None:
        self.worlds = [world_of(image) for image in images]
        self.turn_deg, self.scale = turn_deg, scale
        self.seen: np.ndarray | None = None

    def __call__(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.seen = pixels
        rng = np.random.default_rng(0)
        poses, matrices = [], []
        for number, world in enumerate(self.worlds):
            if world is None:  # a photo without truth
                poses.append(np.column_stack([np.eye(3), [number, 0, 0]]))
                matrices.append(np.diag([400.0, 400.0, 1.0]))
                continue
            turn = Rotation.from_rotvec(np.radians(self.turn_deg) * rng.standard_normal(3)).as_matrix()
            rotation = turn @ world.camera.rotation
            poses.append(np.column_stack([rotation, -self.scale * rotation @ world.camera.position]))
            camera = world.intrinsics
            height, width = pixels.shape[2:]
            matrices.append(np.diag([camera.fx * width / camera.width, camera.fy * height / camera.height, 1.0]))
        return np.array(poses, np.float32), np.array(matrices, np.float32)
