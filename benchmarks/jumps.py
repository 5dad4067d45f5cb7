"""How far a reconstruction moves when one pixel of the photo changes by one level.

    python benchmarks/jumps.py PHOTO ... [--pixels 3] [--set relative_pointmap.options.products=float32]

Changes one channel of one pixel at random, reconstructs anew without the cache, and compares with the unchanged photo.
A row per photo has the median over the changed pixels, and the largest, of: the median distance between the two point
maps of the scene; the distance between the two positions of the vertex that moves most; the share of contact labels
that differ. Networks see smaller images than the photo, and rounding often absorbs the level: then nothing moves at
all. Take enough pixels that the largest values mean something.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physic_core.configuration.model import load_config
from physic_core.io.photo import read_photo
from physic_core.pipeline.run import Pipeline
from physic_core.types import Reconstruction

TITLES = ("scene, median mm", "worst vertex mm", "labels %")


@dataclass(frozen=True)
class Jump:
    """Difference between two reconstructions of almost the same photo.

    Attributes:
        scene_mm: median distance between their scene points, mm.
        vertex_mm: distance between the positions of the vertex that moves most, over all people, mm.
        labels: % of the contact labels of all people that differ.
    """

    scene_mm: float
    vertex_mm: float
    labels: float


def main() -> int:
    """Measure each photo and print its row."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("photos", nargs="+", type=Path)
    parser.add_argument("--pixels", type=int, default=3, help="changed pixels per photo, one at a time")
    parser.add_argument("--seed", type=int, default=0, help="of the pixels")
    parser.add_argument("--preset", default="embedded")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="setting that differs")
    given = parser.parse_args()
    config = load_config(preset=given.preset, overrides=["run.cache=false", *given.set])
    print(f"{'median; largest of pixels':34}" + "".join(f"{title:>20}" for title in TITLES), flush=True)
    found = []
    with Pipeline(config) as pipeline:
        for photo in given.photos:
            image = read_photo(photo).image
            unchanged = pipeline(image)
            jumps = [jump(unchanged, pipeline(other)) for other in changed(image, given.pixels, given.seed)]
            found += jumps
            print(row(photo.name, jumps), flush=True)
    if len(given.photos) > 1:
        print(row("all", found))
    return 0


def changed(image: NDArray[np.uint8], count: int, seed: int) -> Iterator[NDArray[np.uint8]]:
    """Yield copies of an image (H, W, 3), each with one value that differs by one level."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        place = tuple(int(rng.integers(length)) for length in image.shape)
        other = image.copy()
        level = int(image[place])
        other[place] = level + 1 if level < 255 else level - 1
        yield other


def jump(one: Reconstruction, two: Reconstruction) -> Jump:
    """Compare two reconstructions; other people, or a scene that is lost, are infinitely far apart."""
    both = one.scene.valid & two.scene.valid
    moved = np.linalg.norm(one.scene.points[both] - two.scene.points[both], axis=-1)
    scene = 1000 * float(np.median(moved)) if both.any() else np.inf
    if len(one.people) != len(two.people):
        return Jump(scene, np.inf, 100.0)
    if not one.people:
        return Jump(scene, 0.0, 0.0)
    pairs = list(zip(one.people, two.people, strict=True))
    apart = [np.linalg.norm(a.vertices - b.vertices, axis=-1).max() for a, b in pairs]
    labels = np.mean([a.contact != b.contact for a, b in pairs])
    return Jump(scene, 1000 * float(max(apart)), 100 * float(labels))


def row(name: str, jumps: list[Jump]) -> str:
    """Return the row of a photo."""
    values = np.array([astuple(one) for one in jumps])
    cells = zip(np.median(values, axis=0), values.max(axis=0), strict=True)
    return f"{name[:33]:34}" + "".join(f"{f'{middle:.2f}; {most:.2f}':>20}" for middle, most in cells)


if __name__ == "__main__":
    sys.exit(main())
