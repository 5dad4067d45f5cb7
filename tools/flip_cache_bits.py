"""Flips single bits in files of the cache, and counts what becomes of them.

``python tools/flip_cache_bits.py --flips 50000`` keeps one answer of each interface, flips one bit of a file at a time,
and reads it. A flipped file must be dropped with a note, or give the same answer to the last bit (dates and the like
are of no account); anything else is a fault. Faults end the tool with code 1.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from physic_core.cache.digest import Digester
from physic_core.cache.folders import CACHES
from physic_core.cache.result_cache import CacheKey, ResultCache
from physic_core.types import (
    Bodies,
    BodyParameters,
    ContactProbability,
    DepthMap,
    Hands,
    Intrinsics,
    Keypoints,
    Mesh,
    People,
    Pointmap,
    RestMesh,
)

HEIGHT, WIDTH, PEOPLE, JOINTS, VERTICES = 18, 24, 2, 17, 40


def one_of_each(seed: int = 0) -> dict[str, object]:
    """Interface -> an answer, every optional field filled; small, so that many flips meet headers and names."""
    random = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return random.normal(size=shape).astype(np.float32)

    camera = Intrinsics.from_focal(30, WIDTH, HEIGHT, "exif")
    seen = random.random((HEIGHT, WIDTH)) > 0.3
    faces = random.integers(0, VERTICES, (60, 3)).astype(np.int32)
    rest = RestMesh("smpl", numbers(VERTICES, 3), faces)
    keypoints = Keypoints(numbers(PEOPLE, JOINTS, 2), random.random((PEOPLE, JOINTS)), "coco17", numbers(2, JOINTS, 3))
    masks = random.random((PEOPLE, HEIGHT, WIDTH)) > 0.5
    widths = (3, 63, 45, 45, 3, 3, 3, 10, 10, 3)
    parameters = BodyParameters(*(numbers(PEOPLE, width) for width in widths))
    mesh = Mesh("smpl", numbers(PEOPLE, VERTICES, 3), faces, rest.vertices)
    observed = random.random((PEOPLE, 55)) > 0.5
    return {
        "segmenter": People(masks, numbers(PEOPLE, 4), random.random(PEOPLE), seen, keypoints),
        "inpainter": random.integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8),
        "metric_depth": DepthMap(np.where(seen, numbers(HEIGHT, WIDTH), np.nan), camera, 0.1, ("a note",)),
        "relative_pointmap": Pointmap(numbers(HEIGHT, WIDTH, 3), seen, "scale", camera, ("é",)),
        "keypoint_detector": keypoints,
        "body_estimator": Bodies(parameters, "smpl", observed, numbers(PEOPLE, 55, 3), mesh),
        "hand_estimator": Hands(numbers(PEOPLE, 2, 15, 3), random.random((PEOPLE, 2)), numbers(PEOPLE, 2, 3)),
        "contact_prior": ContactProbability(random.random((PEOPLE, VERTICES)), "smpl", rest),
    }


def question(interface: str) -> CacheKey:
    """What an answer of an interface is kept under here."""
    return CacheKey(f"{interface}-flipped-0{CACHES['results'][1]}", {"interface": interface})


def flip(folder: Path, flips: int, seed: int = 0) -> tuple[Counter[str], list[str]]:
    """Flip bits one at a time, an equal number in the file of each interface.

    Returns:
        How many files were "dropped" and how many gave the "same" answer; and the faults, in words.
    """
    random, faults, outcomes = np.random.default_rng(seed), [], Counter[str]()
    for interface, answer in one_of_each().items():
        cache, asked = ResultCache(folder, 1 << 30), question(interface)
        cache.write(asked, answer)
        path = folder / asked.name
        whole, digest = path.read_bytes(), Digester().digest(cache.read(asked))
        for bit in random.integers(0, 8 * len(whole), -(-flips // 8)):
            flipped = bytearray(whole)
            flipped[bit // 8] ^= 1 << (bit % 8)
            path.write_bytes(flipped)
            cache.notes.clear()
            title = f"{interface}, bit {bit}"
            try:
                found = cache.read(asked)
            except Exception as error:
                faults.append(f"{title}: {type(error).__name__}: {error}")
                continue
            if found is not None:
                outcomes["same"] += 1
                if Digester().digest(found) != digest:
                    faults.append(f"{title}: another answer was used")
            else:
                outcomes["dropped"] += 1
                if path.exists() or len(cache.notes) != 1:
                    faults.append(f"{title}: not dropped with one note, but with {cache.notes}")
    return outcomes, faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flips", type=int, default=50_000)
    parser.add_argument("--seed", type=int, default=0)
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        outcomes, faults = flip(Path(folder), wanted.flips, wanted.seed)
    print(f"{sum(outcomes.values())} flips: {dict(outcomes)}, {len(faults)} faults")
    print("\n".join(faults[:20]))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
