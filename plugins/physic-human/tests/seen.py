"""What perfect networks would know: which world a photo shows, and which part of it a crop shows.

A picture of coordinates stands in for the photo that crops are made of: red grows from left to
right, green from top to bottom, blue is the same everywhere. So a crop says itself where it was
taken, whether it is mirrored and in which order its channels come, whatever code made it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physic_core.body import load_body
from physic_core.body.bones import rotations_from_parameters
from physic_testing.worlds import World, world_of

BLUE = 64
MEAN = np.array([0.485, 0.456, 0.406])
STD = np.array([0.229, 0.224, 0.225])


def network_of(backend):
    """Return the network that a backend has loaded from its checkout; stand-ins record there what
    they are shown.
    """
    return backend._network


def coordinates(height, width):
    """The picture of coordinates (H, W, 3) uint8."""
    picture = np.full((height, width, 3), BLUE, np.uint8)
    picture[..., 0] = np.round(40 + 200 * np.arange(width) / width)
    picture[..., 1] = np.round(40 + 200 * np.arange(height) / height)[:, None]
    return picture


class OnWorlds:
    """A checkout backend whose network is one that recognises worlds, so that no code or weights
    are needed.
    """

    perfect_network: type[Any]

    def missing(self) -> tuple[str, ...]:
        return ()

    def build(self, device: str) -> Any:
        return self.perfect_network()


class SeesCrops:
    """A network that is shown crops of the picture of coordinates, and is told which world the
    photo shows.
    """

    world: World | None = None
    size = (1, 1)


class CropsOnWorlds(OnWorlds):
    """The same, where the network is shown crops of the picture of coordinates and knows the world
    of the photo.
    """

    def infer(self, image: np.ndarray, *estimates: Any) -> Any:
        network = network_of(self)
        if network is not None:
            network.world = world_of(image)
            network.size = image.shape[:2]
        shown = (
            coordinates(*image.shape[:2])
            if image.shape[2:] == (3,) and image.dtype == np.uint8
            else image
        )
        return super().infer(shown, *estimates)


@dataclass(frozen=True)
class Place:
    """Where a crop was taken.

    Attributes:
        origin: (2,) px of the photo at crop pixel (0, 0).
        step: (2,) px of the photo from one crop pixel to the next; x is negative in a mirrored
            crop.
        side: of the crop, px of the crop.
    """

    origin: np.ndarray
    step: np.ndarray
    side: int

    @property
    def mirrored(self) -> bool:
        return bool(self.step[0] < 0)

    def at(self, share: float) -> np.ndarray:
        """(2,) px of the photo at the same share of both sides, 0.5 being crop pixel side / 2."""
        return self.origin + self.step * share * self.side


def place_of(crop, height, width):
    """From a crop (S, S, 3) of the picture of coordinates of a photo, red, green, blue in grey
    levels.

    Raises:
        AssertionError: its channels come in another order.
    """
    inside = crop.min(axis=2) > 30
    assert inside.sum() > 50, "a crop of nothing"
    assert abs(np.median(crop[inside][:, 2]) - BLUE) < 4, (
        f"blue is {np.median(crop[inside], axis=0)}"
    )
    rows, columns = np.nonzero(inside)
    origin = np.zeros(2)
    step = np.zeros(2)
    for axis, (places, size) in enumerate(((columns, width), (rows, height))):
        values = (crop[inside][:, axis] - 40) / 200 * size
        # Pixels at the border of the photo are mixed with what is outside, and count little in a
        # robust fit.
        step[axis], origin[axis] = np.polyfit(places, values, 1)
        error = np.abs(values - origin[axis] - step[axis] * places)
        near = error <= np.quantile(error, 0.8) + 1e-9
        step[axis], origin[axis] = np.polyfit(places[near], values[near], 1)
    return Place(origin, step, crop.shape[1])


def normalised_back(planes):
    """(3, S, S) of a network -> (S, S, 3) grey levels."""
    return 255 * (planes.transpose(1, 2, 0) * STD + MEAN)


def nearest(points, place):
    """Row of the point (N, 2) that is nearest to a place (2,)."""
    return int(np.linalg.norm(points - place, axis=1).argmin())


def pixels(points, world):
    """Points (..., 3) of the camera frame -> px (..., 2)."""
    k = world.intrinsics
    return points[..., :2] / points[..., 2:] * [k.fx, k.fy] + [k.cx, k.cy]


@cache
def smpl_arrays():
    """A made-up SMPL file: points on the embedded body's surface, its joints, its weights; no
    number is anybody's.

    Its origin is not its pelvis, as in the true one.
    """
    rng = np.random.default_rng(0)
    body = load_body("embedded")
    rotations, betas, transl = body.zero_pose()
    posed = body(rotations, betas, transl)
    vertices = posed.vertices[0].numpy().astype(float)
    joints = posed.joints[0].numpy().astype(float)
    weights = body.skin.weights.numpy().T
    faces = body.faces.numpy()
    outer = body.outer.numpy()
    faces = faces[outer[faces].all(axis=1)]
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = rng.choice(len(faces), 6890, p=area / area.sum())
    share = rng.dirichlet([2, 2, 2], 6890)
    template = np.einsum("vk,vki->vi", share, corners[chosen])
    skin = np.einsum("vk,vkj->vj", share, weights[faces[chosen]])
    origin = np.array([0.01, 0.21, -0.02])
    hands = [25 + 3, 40 + 3]
    weights24 = np.zeros((6890, 24))
    weights24[:, :22] = skin[:, :22]
    weights24[:, 15] += skin[:, 22:25].sum(axis=1)
    weights24[:, 22], weights24[:, 23] = skin[:, 25:40].sum(axis=1), skin[:, 40:].sum(axis=1)
    joints24 = joints[[*range(22), *hands]]
    # Rows of weights that sum to 1 and give the joints: the nearest points, moved by the least
    # change.
    regressor = np.zeros((24, 6890))
    for j, joint in enumerate(joints24):
        near = np.argsort(np.linalg.norm(template - joint, axis=1))[:200]
        system = np.concatenate([template[near].T, np.ones((1, 200))])
        wanted = np.concatenate([joint, [1.0]])
        even = np.full(200, 1 / 200)
        regressor[j, near] = even + np.linalg.pinv(system) @ (wanted - system @ even)
    from scipy.spatial import cKDTree

    _, around = cKDTree(template).query(template, 4)
    triangles = np.concatenate([around[:, [0, 1, 2]], around[:, [0, 2, 3]]])[:13776]
    shapedirs = np.zeros((6890, 3, 10))
    shapedirs[:, 1, 0] = 0.05 * (template[:, 1] - template[:, 1].min())
    return {
        "v_template": template - origin,
        "f": triangles.astype(np.uint32),
        "shapedirs": shapedirs,
        "posedirs": np.zeros((6890, 3, 207), np.float32),
        "J_regressor": regressor,
        "weights": weights24,
        "kintree_table": np.stack(
            [
                [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21],
                range(24),
            ]
        ).astype(np.int64),
    }


def smpl_contact(world):
    """(N, 6890) bool: the world's contact on the made-up SMPL."""
    from scipy.spatial import cKDTree

    body = load_body("embedded")
    rest = body(*body.zero_pose()).vertices[0].numpy()
    template = smpl_arrays()["v_template"] + [0.01, 0.21, -0.02]
    outer = np.flatnonzero(world.outer)
    _, around = cKDTree(rest[outer]).query(template)
    return world.contact[:, outer[around]]


def smpl_pose(world):
    """(N, 24, 3) rotation vectors of the world's bodies."""
    p = world.parameters
    count = len(p.transl)
    full = np.concatenate([p.global_orient, p.body_pose], axis=1).reshape(count, 22, 3)
    return np.concatenate([full, np.zeros((count, 2, 3))], axis=1)


def wrist_turns(world):
    """(N, 2, 3) rotation of each whole hand from the T-pose to the camera frame, left then
    right.
    """
    p = world.parameters
    body = load_body("embedded")
    given = (torch.from_numpy(np.array(value)) for value in (p.betas, p.transl))
    with torch.no_grad():
        turns = (
            body(rotations_from_parameters(p), *given, joints_only=True)
            .world[:, [20, 21]]
            .double()
            .numpy()
        )
    return Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 2, 3)
