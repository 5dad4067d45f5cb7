"""Appearance of the people: skin, hair, face, clothes and shoes, as colours on the rest body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_testing.worlds.posing import rest_body
from physic_testing.worlds.reproducible_math import apply, norm
from physic_testing.worlds.textures import noise

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import FloatArray

__all__ = ["Clothes"]

_SKIN = (
    (0.80, 0.58, 0.46),
    (0.55, 0.36, 0.25),
    (0.90, 0.70, 0.58),
    (0.38, 0.25, 0.18),
    (0.72, 0.52, 0.40),
)
_TOPS = (
    (0.16, 0.28, 0.52),
    (0.62, 0.18, 0.16),
    (0.15, 0.42, 0.30),
    (0.70, 0.56, 0.18),
    (0.78, 0.78, 0.76),
    (0.42, 0.34, 0.50),
    (0.20, 0.20, 0.22),
    (0.76, 0.48, 0.42),
)
_BOTTOMS = (
    (0.15, 0.20, 0.34),
    (0.28, 0.28, 0.30),
    (0.46, 0.40, 0.30),
    (0.12, 0.12, 0.13),
    (0.34, 0.40, 0.46),
)
_HAIR = (
    (0.05, 0.04, 0.03),
    (0.22, 0.13, 0.07),
    (0.52, 0.38, 0.20),
    (0.45, 0.44, 0.43),
    (0.36, 0.16, 0.08),
)
_SKIN_PART, _TOP, _BOTTOM, _SHOE, _HAIR_PART = range(5)


class Clothes:
    """One person's colours.

    Args:
        model: whose mesh it is.
        rng: draws them.
    """

    def __init__(self, model: BodyModel, rng: np.random.Generator) -> None:
        rest, joints = rest_body(model)
        self._faces = model.faces.numpy()
        self._rest = rest
        kind = _kinds(model, rest, joints, rng)
        palette = np.array(
            [_pick(rng, p) for p in (_SKIN, _TOPS, _BOTTOMS)] + [_shoes(rng), _pick(rng, _HAIR)]
        )
        self._colour = palette[kind]
        _paint_face(self._colour, rest, joints, kind, palette[_SKIN_PART])
        # The kind of each face is that of its first corner, so that hems are sharp.
        self._kind = kind[self._faces[:, 0]]
        self._seed = int(rng.integers(1 << 30))
        self._stripes = (int(rng.integers(4)), float(rng.uniform(0.03, 0.10)), _pick(rng, _TOPS))

    def albedo(self, face: NDArray[np.int64], corners: FloatArray, blur: FloatArray) -> FloatArray:
        """Return colours (n, 3) at barycentric coordinates (n, 3) of faces (n,), with pixel
        footprint (n,), m.
        """
        rng = np.random.default_rng(self._seed)
        ends = self._faces[face]
        kind = self._kind[face]
        place = _blend(self._rest[ends], corners)
        own = self._colour[ends[:, 0]]
        blended = _blend(self._colour[ends], corners)
        colour = np.where((kind == _SKIN_PART)[:, None], blended, own)
        pattern, period, second = self._stripes
        if pattern:
            along = (place[:, 1], place[:, 0], place[:, 0] + place[:, 1])[pattern - 1]
            striped = (kind == _TOP) & (np.mod(along, period) < 0.4 * period) & (blur < period / 2)
            colour[striped] = second
        u = place[:, 0] + 0.7 * place[:, 2]
        v = place[:, 1] + 0.3 * place[:, 2]
        folds = noise(u, 0.5 * v, blur, 0.8, rng)
        thread = noise(u, v, blur, 0.12, rng)
        amount = np.array([[0.08, 0.06], [0.22, 0.16], [0.22, 0.20], [0.10, 0.10], [0.30, 0.50]])[
            kind
        ]
        shaded: FloatArray = np.clip(
            colour * (1 + amount[:, 0] * folds + amount[:, 1] * thread)[:, None], 0, 1
        )
        return shaded


def _blend(ends: FloatArray, corners: FloatArray) -> FloatArray:
    """Interpolate corner values (n, 3, 3) with barycentric weights (n, 3)."""
    return apply(np.swapaxes(ends, 1, 2), corners)


def _pick(rng: np.random.Generator, palette: tuple[tuple[float, float, float], ...]) -> FloatArray:
    """Draw a slightly varied colour from a palette."""
    colour: FloatArray = np.array(palette[rng.integers(len(palette))]) * rng.uniform(0.88, 1.12)
    colour = colour * rng.uniform(0.96, 1.04, 3)
    return colour


def _shoes(rng: np.random.Generator) -> FloatArray:
    """Draw a shoe colour."""
    colour: FloatArray = (
        np.array([0.12, 0.11, 0.11]) if rng.random() < 0.6 else rng.uniform(0.3, 0.8) * np.ones(3)
    )
    return colour


def _kinds(
    model: BodyModel, rest: FloatArray, joints: FloatArray, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return the garment (V,) of each vertex: skin, top, bottom, shoe or hair."""
    part = np.array(model.part_names)[model.part_of_vertex.numpy()]
    kind = np.full(len(rest), _SKIN_PART)
    upper_arm, lower_arm = (np.char.endswith(part, name) for name in ("upper_arm", "lower_arm"))
    # In the rest pose the arms stretch along x and the legs along y.
    elbow = np.abs(joints[[18, 19], 0]).mean()
    wrist = np.abs(joints[[20, 21], 0]).mean()
    shoulder = np.abs(joints[[16, 17], 0]).mean()
    sleeve = rng.choice([(shoulder + elbow) / 2, elbow, (elbow + wrist) / 2, wrist - 0.02])
    kind[(part == "torso") | ((upper_arm | lower_arm) & (np.abs(rest[:, 0]) < sleeve))] = _TOP
    knee = joints[4:6, 1].mean()
    ankle = joints[7:9, 1].mean()
    hip = joints[1:3, 1].mean()
    hem = rng.choice([(hip + 2 * knee) / 3, knee - 0.05, ankle + 0.03, ankle + 0.03])
    leg = np.char.endswith(part, "_leg")
    kind[leg & (rest[:, 1] > hem)] = _BOTTOM
    kind[(part == "torso") & (rest[:, 1] < hip + rng.uniform(0.0, 0.10))] = _BOTTOM
    kind[np.char.endswith(part, "foot")] = _SHOE
    kind[(part == "torso") & (rest[:, 1] > joints[12, 1] + 0.01)] = _SKIN_PART
    eyes = joints[23:25].mean(axis=0)
    head = joints[15]
    brow = eyes[1] + rng.uniform(0.04, 0.055)
    nape = eyes[1] - rng.choice([0.0, 0.06, 0.11])
    hair = (rest[:, 1] > brow) | ((rest[:, 2] < head[2] + 0.01) & (rest[:, 1] > nape))
    kind[(part == "head") & hair] = _HAIR_PART
    return kind


def _paint_face(
    colour: FloatArray,
    rest: FloatArray,
    joints: FloatArray,
    kind: NDArray[np.int64],
    skin: FloatArray,
) -> None:
    """Paint eyes, brows and lips relative to the eye centres."""
    for eye in joints[23:25]:
        radius = norm(rest - eye)
        ball = (radius < 0.0135) & (rest[:, 2] > eye[2])
        colour[ball] = 0.82
        colour[ball & (norm((rest - eye) * (1, 1, 0)) < 0.006)] = (0.10, 0.07, 0.05)
        away = np.abs(rest - eye)
        brow = (
            (away[:, 0] < 0.022)
            & (np.abs(rest[:, 1] - eye[1] - 0.022) < 0.005)
            & (rest[:, 2] > eye[2])
        )
        colour[brow & (kind == _SKIN_PART)] = 0.35 * skin
    middle = joints[23:25].mean(axis=0)
    lips = (
        (np.abs(rest[:, 0]) < 0.024)
        & (np.abs(rest[:, 1] - middle[1] + 0.068) < 0.009)
        & (rest[:, 2] > middle[2])
    )
    colour[lips] = skin * [0.85, 0.55, 0.55]
