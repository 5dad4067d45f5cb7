"""Which part of a photo a crop shows, and a made-up body file.

A picture of coordinates stands in for the photo that crops are made of: red grows from left to
right, green from top to bottom, blue is the same everywhere. So a crop says itself where it was
taken, whether it is mirrored and in which order its channels come, whatever code made it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from physic_core.body import load_body

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
