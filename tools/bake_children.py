"""Fit the ages of children, and bake the bodies of children in worlds, both from Anny's calibrated
distribution.

Needs what ``tools/bake_body.py`` needs, and about a minute. Run from the repository's root:

    python tools/bake_children.py

It writes two files:

- ``physic_core/body/ages.json``: the distribution of stature by age, and the shape of children by
  stature, as shape components of the embedded body. Its error is measured on shapes that took no
  part in the fit.
- ``plugins/physic-testing/physic_testing/worlds/children.npz``: 24 children of 1 to 15 years as
  Anny shapes them, with what the shape components cannot express. They took no part in the fit
  either.
"""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import bake_body

AGES_FILE = bake_body.ROOT / "physic_core" / "body" / "ages.json"
WORLDS_FILE = (
    bake_body.ROOT / "plugins" / "physic-testing" / "physic_testing" / "worlds" / "children.npz"
)
# numbers of shapes, and seeds
FIT = (3000, 101)
TEST = (600, 303)
WORLDS = (240, 404)
YEARS = (0.0, 16.0)
WORLD_YEARS = np.linspace(1.0, 15.0, 24)  # of the shapes that are kept, those of the nearest ages
EDGES = (0.0, 0.5, *range(1, 17))  # years, of the age classes
DEGREE = 3  # of betas as polynomials of log stature
STEP_M = 2e-4  # of stored residuals
INFO = (
    "Fitted by tools/bake_children.py to shapes of Anny 0.6.2 (Apache-2.0 AND CC0-1.0, see "
    "NOTICE-embedded.md)."
)


class Mannequin:
    """Shapes of Anny, faired as those of the embedded body are, and the embedded body's shape
    components.
    """

    def __init__(self) -> None:
        adults = bake_body.draw_samples(300, (18.0, 80.0), seed=7)
        joints = bake_body.place_joints(adults)
        vertices = bake_body.close_cavities(
            adults.vertices - joints[:, :1], adults.faces, adults.cavity
        )
        mean = vertices.mean(0)
        self.laplacian = bake_body.cotangent_laplacian(mean, adults.faces)
        weights = bake_body.merge_weights(adults)
        self.softness = bake_body.softness_of(mean, (joints - joints[:, :1]).mean(0), weights)
        asset = np.load(bake_body.ASSET)
        self.template, self.directions = (
            asset["v_template"].astype(float),
            asset["shapedirs"].astype(float),
        )
        self.joint_template = asset["J_template"].astype(float)
        self.joint_directions = asset["J_shapedirs"]

    def draw(
        self, count: int, years: tuple[float, float], seed: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return vertices (N, V, 3) and joints (N, 55, 3) in metres about the pelvis, and ages (N,)
        in years.
        """
        samples = bake_body.draw_samples(count, years, seed)
        joints = bake_body.place_joints(samples)
        vertices = bake_body.close_cavities(
            samples.vertices - joints[:, :1], samples.faces, samples.cavity
        )
        vertices = bake_body.fair(vertices, *self.laplacian, self.softness)
        return vertices, joints - joints[:, :1], samples.age

    def betas(self, vertices: np.ndarray) -> np.ndarray:
        """Return the nearest betas (N, K)."""
        flat = self.directions.reshape(len(self.directions), -1)
        found: np.ndarray = (vertices - self.template).reshape(len(vertices), -1) @ np.linalg.pinv(
            flat
        )
        return found

    def shape(self, betas: np.ndarray) -> np.ndarray:
        """Return the vertices (N, V, 3) of betas (N, K)."""
        return self.template + np.einsum("nk,kvc->nvc", betas, self.directions)


def log_stature(vertices: np.ndarray) -> np.ndarray:
    """Return log(stature) (N,), metres."""
    height: np.ndarray = np.log(np.ptp(vertices[..., 1], axis=1))
    return height


def fit_ages(body: Mannequin) -> dict[str, object]:
    """Return the contents of ``ages.json``."""
    vertices, _, age = body.draw(FIT[0], YEARS, FIT[1])
    height = log_stature(vertices)
    betas = body.betas(vertices)
    classes = []
    for low, high in pairwise(EDGES):
        own = height[(age >= low) & (age < high)]
        classes.append(
            {
                "years": [low, high],
                "log_stature": [round(float(x), 4) for x in (own.mean(), own.std())],
            }
        )
    shape = np.polynomial.polynomial.polyfit(height, betas, DEGREE)
    vertices, _, age = body.draw(TEST[0], YEARS, TEST[1])
    height = log_stature(vertices)
    z = [
        (h - c["log_stature"][0]) / c["log_stature"][1]  # type: ignore[index]
        for a, h in zip(age, height, strict=True)
        for c in classes
        if c["years"][0] <= a < c["years"][1]
    ]
    predicted = body.shape(np.polynomial.polynomial.polyval(height, shape).T)
    error = {
        "vertices_mm": 1e3 * float(np.linalg.norm(predicted - vertices, axis=-1).mean()),
        "vertices_of_the_nearest_betas_mm": 1e3
        * float(np.linalg.norm(body.shape(body.betas(vertices)) - vertices, axis=-1).mean()),
        "log_stature_rms_in_class_standard_deviations": float(np.sqrt(np.mean(np.square(z)))),
    }
    return {
        "info": INFO,
        "fit": f"{FIT[0]} shapes, seed {FIT[1]}",
        "test": f"{TEST[0]} shapes, seed {TEST[1]}",
        "test_error": {name: round(value, 2) for name, value in error.items()},
        "classes": classes,
        "betas_by_log_stature": [[round(float(x), 4) for x in row] for row in shape],
    }


def bake_children(body: Mannequin) -> dict[str, np.ndarray]:
    """Return the arrays of ``children.npz``: betas, and steps of ``STEP_M`` from their shape to
    Anny's.
    """
    vertices, joints, age = body.draw(
        WORLDS[0], (float(WORLD_YEARS[0]), float(WORLD_YEARS[-1])), WORLDS[1]
    )
    kept = np.abs(age - WORLD_YEARS[:, None]).argmin(1)
    vertices = vertices[kept]
    joints = joints[kept]
    age = age[kept]
    betas = body.betas(vertices).astype(np.float32)
    residual = np.round((vertices - body.shape(betas)) / STEP_M)
    own = body.joint_template + np.einsum("nk,kjc->njc", betas, body.joint_directions)
    return {
        "age": age.astype(np.float32),
        "betas": betas,
        "residual": np.clip(residual, -127, 127).astype(np.int8),
        "step_m": np.array(STEP_M),
        "joints": (joints - own).astype(np.float32),
        "info": np.array(
            INFO.replace("Fitted", "Baked").replace("NOTICE-embedded.md", "the project's NOTICE")
        ),
    }


def _rows(value: object) -> str:
    """Return JSON with one row of a list a line."""
    if not isinstance(value, list):
        return json.dumps(value)
    rows = ",\n".join(f"    {json.dumps(row)}" for row in value)
    return f"[\n{rows}\n  ]"


def main() -> int:
    """Write both files."""
    body = Mannequin()
    found = fit_ages(body)
    lines = ",\n".join(f"  {json.dumps(name)}: {_rows(value)}" for name, value in found.items())
    AGES_FILE.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    WORLDS_FILE.write_bytes(bake_body.pack(bake_children(body)))
    print(found["test_error"], f"{WORLDS_FILE.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
