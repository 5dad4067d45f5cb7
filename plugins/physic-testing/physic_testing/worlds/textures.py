"""Procedural textures of surfaces: wood, cloth, walls, grass and others.

A surface is planar with coordinates u, v in metres. Patterns smaller than a pixel fade out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from physic_core.types import FloatArray

__all__ = ["Decoration", "Patch", "albedo", "noise", "sky"]

_TEXELS = 256


@dataclass(frozen=True)
class Decoration:
    """A rectangle on a surface: a picture, a window or a rug.

    Attributes:
        kind: "picture", "window" or "rug".
        centre: u, v of its centre, m.
        half: half width and half height, m.
        seed: seed of its colours.
    """

    kind: str
    centre: tuple[float, float]
    half: tuple[float, float]
    seed: int


@dataclass(frozen=True)
class Patch:
    """Material and decorations of one surface.

    Attributes:
        material: "planks", "tiles", "carpet", "paving", "asphalt", "grass", "wall", "ceiling",
            "wood", "fabric", "metal", "stone", "brick", "plaster" or "hedge"; others are rendered
            as plaster.
        seed: seed of the colours; the sides of one object share it.
        decorations: rectangles on top; later ones cover earlier ones.
    """

    material: str
    seed: int
    decorations: tuple[Decoration, ...] = ()


def albedo(patch: Patch, u: FloatArray, v: FloatArray, blur: FloatArray) -> FloatArray:
    """Return the colours (n, 3) in [0, 1] at points u, v (n,), with pixel footprint ``blur`` (n,),
    m.
    """
    rng = np.random.default_rng([patch.seed, 77])
    painted = _PAINTERS.get(patch.material, _plaster)(u, v, blur, rng)
    for decoration in patch.decorations:
        a = u - decoration.centre[0]
        b = v - decoration.centre[1]
        here = (np.abs(a) < decoration.half[0]) & (np.abs(b) < decoration.half[1])
        if here.any():
            inside = np.random.default_rng([decoration.seed, 78])
            painted[here] = _DECORATORS[decoration.kind](
                a[here], b[here], blur[here], decoration.half, inside
            )
    return np.clip(painted, 0.0, 1.0)


def noise(
    u: FloatArray, v: FloatArray, blur: FloatArray, period: float, rng: np.random.Generator
) -> FloatArray:
    """Return fractal noise (n,) with mean 0 and standard deviation 0.4, which repeats after
    ``period`` metres.
    """
    shift = rng.uniform(0, _TEXELS, 2)
    levels, starts = _noise_pyramid()
    texel = period / _TEXELS
    level = np.clip(np.floor(np.log2(np.maximum(blur / texel, 1.0))), 0, len(starts) - 1).astype(
        np.int64
    )
    side = _TEXELS >> level
    x = (u / texel + shift[0]) / (1 << level)
    y = (v / texel + shift[1]) / (1 << level)
    x0 = np.floor(x)
    y0 = np.floor(y)
    a = x - x0
    b = y - y0
    left = x0.astype(np.int64) & (side - 1)
    top = y0.astype(np.int64) & (side - 1)
    right = (left + 1) & (side - 1)
    bottom = (top + 1) & (side - 1)
    start = starts[level]

    def at(row: NDArray[np.int64], column: NDArray[np.int64]) -> FloatArray:
        found: FloatArray = levels[start + row * side + column]
        return found

    upper = at(top, left) * (1 - a) + at(top, right) * a
    result: FloatArray = upper * (1 - b) + (at(bottom, left) * (1 - a) + at(bottom, right) * a) * b
    return result


@lru_cache(maxsize=1)
def _noise_pyramid() -> tuple[FloatArray, NDArray[np.int64]]:
    """Return a mipmap of tileable noise, flattened, and the start index of each level."""
    frequency = np.hypot(
        *np.meshgrid(np.fft.fftfreq(_TEXELS), np.fft.rfftfreq(_TEXELS), indexing="ij")
    )
    frequency[0, 0] = np.inf
    phases = np.random.default_rng(5).normal(size=(2, *frequency.shape))
    image = np.fft.irfft2((phases[0] + 1j * phases[1]) / frequency**1.1, (_TEXELS, _TEXELS))
    image *= 0.4 / image.std()
    rows = [image]
    while len(rows[-1]) > 2:
        fine = rows[-1]
        rows.append((fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]) / 4)
    starts = np.cumsum([0, *(level.size for level in rows[:-1])])
    return np.concatenate([level.reshape(-1) for level in rows]), starts


def sky(elevation: FloatArray, azimuth: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the colours (n, 3) of the sky for directions in radians."""
    height = np.clip(elevation / 0.9, 0.0, 1.0)[:, None]
    colour = np.array([0.72, 0.80, 0.88]) * (1 - height) + np.array([0.30, 0.50, 0.80]) * height
    u = azimuth
    v = 2.0 * elevation
    cloud = noise(u, v, np.full(len(u), 0.004), 2.4, rng) + rng.uniform(-0.2, 0.2)
    share = np.clip(1.6 * cloud, 0.0, 0.85)[:, None]
    result: FloatArray = colour * (1 - share) + 0.92 * share
    return result


def _tinted(base: tuple[float, float, float], factor: FloatArray) -> FloatArray:
    """Multiply a base colour by factors (n,)."""
    colours: FloatArray = np.array(base) * factor[:, None]
    return colours


def _one_of(
    rng: np.random.Generator, palette: tuple[tuple[float, float, float], ...]
) -> tuple[float, float, float]:
    """Draw a slightly varied colour from a palette."""
    r, g, b = (
        np.array(palette[rng.integers(len(palette))])
        * rng.uniform(0.88, 1.12)
        * rng.uniform(0.95, 1.05, 3)
    )
    return float(r), float(g), float(b)


def _hash(i: FloatArray, j: FloatArray, salt: float) -> FloatArray:
    """Return pseudo-random numbers (n,) in [0, 1) for integers i, j."""
    mixed: FloatArray = np.mod(np.sin(i * 12.9898 + j * 78.233 + salt) * 43758.5453, 1.0)
    return mixed


def _fade(blur: FloatArray, feature: float) -> FloatArray:
    """Return 1 where a feature is larger than a pixel, falling to 0 where it is smaller."""
    result: FloatArray = np.clip(1.5 - blur / feature, 0.0, 1.0)
    return result


def _joints(
    u: FloatArray, v: FloatArray, blur: FloatArray, size: tuple[float, float], gap: float
) -> FloatArray:
    """Return 1 on the joints between rectangles of ``size``, else 0; anti-aliased."""
    distance = np.minimum(
        np.abs(u - size[0] * np.round(u / size[0])), np.abs(v - size[1] * np.round(v / size[1]))
    )
    width = np.maximum(gap, blur)
    joint: FloatArray = (
        np.clip(0.5 + (width / 2 - distance) / np.maximum(blur, 1e-4), 0, 1) * gap / width
    )
    return joint * _fade(blur, min(size))


def _planks(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(
        rng, ((0.58, 0.40, 0.25), (0.72, 0.56, 0.38), (0.42, 0.28, 0.18), (0.66, 0.60, 0.52))
    )
    wide = rng.uniform(0.09, 0.18)
    long = rng.uniform(0.9, 1.5)
    salt = float(rng.integers(1000))
    row = np.floor(u / wide)
    along = v + long * _hash(row, row, salt)
    tone = _hash(row, np.floor(along / long), salt) - 0.5
    grain = noise(8 * u, 0.6 * v + 3 * tone, 4 * blur, 1.1, rng)
    factor = 1 + 0.35 * tone * _fade(blur, wide) + 0.22 * grain
    return _tinted(
        base,
        factor * (1 - 0.5 * _joints(u - wide / 2, along - long / 2, blur, (wide, long), 0.006)),
    )


def _tiles(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.72, 0.70, 0.66), (0.60, 0.46, 0.38), (0.48, 0.50, 0.52)))
    side = rng.uniform(0.25, 0.5)
    salt = float(rng.integers(1000))
    tone = _hash(np.round(u / side), np.round(v / side), salt) - 0.5
    factor = 1 + 0.15 * tone * _fade(blur, side) + 0.18 * noise(u, v, blur, 0.9, rng)
    joint = _joints(u - side / 2, v - side / 2, blur, (side, side), 0.008)
    return _tinted(base, factor * (1 - 0.45 * joint))


def _carpet(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(
        rng, ((0.45, 0.42, 0.40), (0.36, 0.40, 0.48), (0.52, 0.42, 0.34), (0.40, 0.46, 0.40))
    )
    return _tinted(base, 1 + 0.3 * noise(u, v, blur, 0.35, rng) + 0.2 * noise(u, v, blur, 2.3, rng))


def _paving(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.56, 0.54, 0.51), (0.58, 0.48, 0.42), (0.46, 0.46, 0.48)))
    size = (rng.uniform(0.3, 0.6), rng.uniform(0.2, 0.6))
    salt = float(rng.integers(1000))
    row = np.round(v / size[1])
    shifted = u + 0.5 * size[0] * np.mod(row, 2)
    tone = _hash(np.round(shifted / size[0]), row, salt) - 0.5
    factor = 1 + 0.25 * tone * _fade(blur, size[1]) + 0.25 * noise(u, v, blur, 0.7, rng)
    factor += 0.12 * noise(u, v, blur, 5.0, rng)
    joint = _joints(shifted - size[0] / 2, v - size[1] / 2, blur, size, 0.012)
    return _tinted(base, factor * (1 - 0.5 * joint))


def _asphalt(
    u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator
) -> FloatArray:
    base = _one_of(rng, ((0.34, 0.34, 0.35), (0.42, 0.41, 0.40)))
    colour = _tinted(
        base, 1 + 0.45 * noise(u, v, blur, 0.3, rng) + 0.25 * noise(u, v, blur, 4.1, rng)
    )
    where = rng.uniform(1.5, 4.0)
    width = rng.uniform(0.08, 0.15)
    marked = (np.abs(u - where) < width / 2) & (np.mod(v, 3.0) < 2.0)
    colour[marked] = 0.8
    return colour


def _grass(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.30, 0.42, 0.18), (0.38, 0.46, 0.22), (0.26, 0.38, 0.20)))
    fine = noise(u, v, blur, 0.4, rng)
    broad = noise(u, v, blur, 3.7, rng)
    colour = _tinted(base, 1 + 0.6 * fine + 0.3 * broad)
    dry = np.clip(0.5 * noise(u, v, blur, 7.9, rng) + 0.1, 0, 0.5)[:, None]
    result: FloatArray = (
        colour * (1 - dry) + np.array([0.55, 0.48, 0.28]) * (1 + 0.4 * fine[:, None]) * dry
    )
    return result


def _hedge(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.20, 0.34, 0.14), (0.24, 0.36, 0.20), (0.30, 0.34, 0.14)))
    return _tinted(base, 1 + 0.9 * noise(u, v, blur, 0.9, rng) + 0.4 * noise(u, v, blur, 0.25, rng))


def _wall(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Colour a wall: plain, striped or patterned paint above a skirting board; v is the height."""
    base = _one_of(
        rng,
        (
            (0.78, 0.76, 0.70),
            (0.66, 0.72, 0.76),
            (0.74, 0.64, 0.56),
            (0.62, 0.70, 0.60),
            (0.82, 0.80, 0.78),
        ),
    )
    factor = 1 + 0.06 * noise(u, v, blur, 1.9, rng) + 0.05 * noise(u, v, blur, 0.3, rng)
    kind = rng.integers(3)
    period = rng.uniform(0.12, 0.4)
    if kind == 1:
        factor += 0.06 * np.sign(np.sin(2 * np.pi * u / period)) * _fade(blur, period)
    elif kind == 2:
        factor += (
            0.12
            * (np.sin(2 * np.pi * u / period) * np.sin(2 * np.pi * v / period))
            * _fade(blur, period)
        )
    colour = _tinted(base, factor)
    board = v < rng.uniform(0.06, 0.14)
    colour[board] = 0.85 if rng.random() < 0.5 else 0.25
    return colour


def _ceiling(
    u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator
) -> FloatArray:
    return _tinted((0.88, 0.88, 0.86), 1 + 0.05 * noise(u, v, blur, 1.3, rng))


def _wood(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(
        rng, ((0.50, 0.32, 0.20), (0.66, 0.48, 0.30), (0.34, 0.22, 0.15), (0.74, 0.62, 0.46))
    )
    grain = noise(0.5 * u, 7 * v, 4 * blur, 1.3, rng)
    rings = np.sin(60 * v + 6 * noise(0.4 * u, 2 * v, blur, 1.7, rng)) * _fade(blur, 0.05)
    return _tinted(base, 1 + 0.3 * grain + 0.08 * rings)


def _fabric(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(
        rng,
        (
            (0.36, 0.45, 0.38),
            (0.46, 0.36, 0.34),
            (0.32, 0.36, 0.50),
            (0.58, 0.52, 0.44),
            (0.30, 0.30, 0.32),
        ),
    )
    factor = 1 + 0.25 * noise(u, v, blur, 0.25, rng) + 0.12 * noise(u, v, blur, 1.7, rng)
    kind = rng.integers(3)
    period = rng.uniform(0.04, 0.16)
    if kind == 1:
        factor += 0.22 * np.sign(np.sin(2 * np.pi * u / period)) * _fade(blur, period)
    elif kind == 2:
        check = np.sign(np.sin(2 * np.pi * u / period)) + np.sign(np.sin(2 * np.pi * v / period))
        factor += 0.12 * check * _fade(blur, period)
    return _tinted(base, factor)


def _metal(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.55, 0.56, 0.58), (0.30, 0.31, 0.33), (0.62, 0.58, 0.52)))
    return _tinted(base, 1 + 0.18 * noise(6 * u, 0.4 * v, 4 * blur, 1.1, rng))


def _stone(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.58, 0.56, 0.52), (0.50, 0.48, 0.46), (0.64, 0.58, 0.48)))
    return _tinted(base, 1 + 0.35 * noise(u, v, blur, 0.8, rng) + 0.2 * noise(u, v, blur, 0.2, rng))


def _brick(u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator) -> FloatArray:
    base = _one_of(rng, ((0.55, 0.28, 0.20), (0.60, 0.42, 0.30), (0.44, 0.30, 0.26)))
    size = (0.25, 0.08)
    salt = float(rng.integers(1000))
    row = np.round(v / 0.08)
    shifted = u + 0.5 * size[0] * np.mod(row, 2)
    tone = (_hash(np.round(shifted / size[0]), row, salt) - 0.5) * _fade(blur, size[1])
    colour = _tinted(base, 1 + 0.4 * tone + 0.3 * noise(u, v, blur, 0.5, rng))
    joint = 0.8 * _joints(shifted - size[0] / 2, v - size[1] / 2, blur, size, 0.012)[:, None]
    result: FloatArray = colour * (1 - joint) + 0.68 * joint
    return result


def _plaster(
    u: FloatArray, v: FloatArray, blur: FloatArray, rng: np.random.Generator
) -> FloatArray:
    base = _one_of(rng, ((0.76, 0.74, 0.70), (0.74, 0.68, 0.58), (0.62, 0.66, 0.70)))
    return _tinted(base, 1 + 0.1 * noise(u, v, blur, 1.5, rng) + 0.08 * noise(u, v, blur, 0.3, rng))


def _picture(
    a: FloatArray,
    b: FloatArray,
    blur: FloatArray,
    half: tuple[float, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Colour a framed landscape of two colours."""
    low, high = (np.array(_one_of(rng, _BRIGHT)) for _ in range(2))
    bend = 0.4 * noise(a, b, blur, 3 * half[0], rng)
    share = np.clip(0.5 + 2 * (b / half[1] * rng.uniform(0.3, 1) + 1.5 * bend), 0, 1)[:, None]
    content = (low * (1 - share) + high * share) * (1 + 0.5 * noise(a, b, blur, half[0], rng))[
        :, None
    ]
    frame = np.minimum(half[0] - np.abs(a), half[1] - np.abs(b))[:, None]
    edge = rng.uniform(0.02, 0.05)
    mount = rng.uniform(0.0, 0.06)
    wood = rng.uniform(0.08, 0.5) * np.array([1.0, 0.85, 0.7])
    return np.where(frame < edge, wood, np.where(frame < edge + mount, 0.88, content))


def _window(
    a: FloatArray,
    b: FloatArray,
    blur: FloatArray,
    half: tuple[float, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Colour a window with sky and trees behind white bars."""
    horizon = rng.uniform(-0.5, 0.1) * half[1] + 0.3 * noise(a, 0 * b, blur, 2.0, rng)
    above = np.clip((b - horizon) / 0.03, 0, 1)[:, None]
    outside = np.array([0.72, 0.85, 0.97]) * above + np.array([0.30, 0.42, 0.22]) * (1 - above)
    outside = outside * (1 + 0.25 * noise(a, b, blur, 0.8, rng))[:, None]
    frame = np.minimum(half[0] - np.abs(a), half[1] - np.abs(b))
    bars = np.minimum(np.abs(a), np.abs(b - 0.2 * half[1]))
    return np.where(((frame < 0.05) | (bars < 0.02))[:, None], 0.9, outside)


def _rug(
    a: FloatArray,
    b: FloatArray,
    blur: FloatArray,
    half: tuple[float, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Colour a rug with a border and a pattern of diamonds."""
    ground, mark, border = (np.array(_one_of(rng, _BRIGHT)) for _ in range(3))
    period = rng.uniform(0.2, 0.5)
    wave = np.cos(2 * np.pi * a / period) + np.cos(2 * np.pi * b / period)
    share = (np.clip(3 * wave, -1, 1) * _fade(blur, period) / 2 + 0.5)[:, None]
    content = ground * (1 - share) + mark * share
    frame = np.minimum(half[0] - np.abs(a), half[1] - np.abs(b))[:, None]
    colour = np.where(frame < rng.uniform(0.06, 0.15), border, content)
    result: FloatArray = colour * (0.9 + 0.35 * noise(a, b, blur, 0.3, rng))[:, None]
    return result


_BRIGHT = (
    (0.72, 0.34, 0.24),
    (0.22, 0.42, 0.56),
    (0.76, 0.62, 0.30),
    (0.34, 0.48, 0.32),
    (0.82, 0.78, 0.70),
    (0.34, 0.26, 0.40),
    (0.20, 0.20, 0.24),
)

_PAINTERS: dict[
    str, Callable[[FloatArray, FloatArray, FloatArray, np.random.Generator], FloatArray]
] = {
    "planks": _planks,
    "tiles": _tiles,
    "carpet": _carpet,
    "paving": _paving,
    "asphalt": _asphalt,
    "grass": _grass,
    "wall": _wall,
    "ceiling": _ceiling,
    "wood": _wood,
    "fabric": _fabric,
    "metal": _metal,
    "stone": _stone,
    "brick": _brick,
    "plaster": _plaster,
    "hedge": _hedge,
}
_DECORATORS = {"picture": _picture, "window": _window, "rug": _rug}
