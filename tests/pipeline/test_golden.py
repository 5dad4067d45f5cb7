"""Numbers of stored worlds, by each engine preset: a change that moves none of them moves no
result.

After a change that is meant to move results, ``python -m tests.pipeline.test_golden`` writes them
again; the commit says which moved, and why.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physic_testing.worlds import load_world
from tests.pipeline.mocks import run

STORED = Path(__file__).with_name("golden.json")
CASES = (
    ("hug", "default"),
    ("child_by_the_hand", "default"),
    ("sit_on_stool", "paper"),
    ("stand", "release"),
    ("lie", "prox"),
)
SETTINGS = ("engine.joint.optimiser.steps=4", "run.threads=1")
MIDDLE = (60, 80)
TOLERANCE = 1e-5  # metres; the plainest kernels of torch move results by 2e-7
VERTICES = 1e-3  # share of vertices that kernels may move over a threshold


def numbers(world, preset):
    """Return name -> numbers of a result, metres where they have a unit."""
    image = load_world(world, (160, 120)).image
    result = run(image, *SETTINGS, f"engine.preset={preset}")
    found = {"middle of the scene": result.scene.points[MIDDLE], "scale": [result.scene.scale]}
    if result.scene.floor is not None:
        found["floor"] = [*result.scene.floor.normal, result.scene.floor.offset]
    for i, person in enumerate(result.people):
        found |= {
            f"pelvis {i}": person.joints[0],
            f"right wrist {i}": person.joints[21],
            f"stature {i}": [person.stature],
            f"share in contact {i}": [person.contact.mean()],
            f"trust {i}": [person.trust],
        }
    return {name: np.round(np.array(values, float), 7).tolist() for name, values in found.items()}


@pytest.mark.parametrize(("world", "preset"), CASES)
def test_the_numbers_of_a_world_are_the_stored_ones(world, preset):
    stored = json.loads(STORED.read_text())[f"{world} {preset}"]
    found = numbers(world, preset)
    assert found.keys() == stored.keys()
    for name, values in stored.items():
        bound = VERTICES if name.startswith("share") else TOLERANCE
        assert found[name] == pytest.approx(values, abs=bound), name


if __name__ == "__main__":
    lines = {f"{world} {preset}": numbers(world, preset) for world, preset in CASES}
    STORED.write_text(json.dumps(lines, indent=1) + "\n")
