"""The offline default on the example photo, with real networks: one man stands whole, one is cut at the hips."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physic_core import Reconstruction, reconstruct
from physic_core.body import load_body
from physic_core.engine.contact.method import ContactMethod
from physic_core.io.photo import read_photo

from .consistency import consistency

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def result() -> Reconstruction:
    return reconstruct(read_photo(EXAMPLES / "basketball.png").image)


def whole_and_cut(result: Reconstruction) -> tuple[int, int]:
    """The man on the left of the photo, and the one on its right."""
    first, second = np.argsort([person.box[0] for person in result.people])
    return int(first), int(second)


def test_both_people_of_the_example_photo_are_found(result: Reconstruction) -> None:
    assert len(result.people) == 2
    whole, cut = whole_and_cut(result)
    assert not result.people[whole].failed_checks
    assert "legs_seen" in result.people[cut].failed_checks
    assert result.people[whole].joints[0, 2] > result.people[cut].joints[0, 2] > 0


def test_the_man_who_is_not_cut_off_stands_on_the_floor(result: Reconstruction) -> None:
    whole, _ = whole_and_cut(result)
    measured = consistency(result, load_body())[whole]
    assert abs(measured.sole_height) < 0.03
    assert measured.keypoint_error_share < 0.02
    assert measured.inside_share < 0.01
    assert abs(measured.lean_deg) < 12
    ankles = result.people[whole].joints[7:9] @ result.scene.floor.normal + result.scene.floor.offset
    neck = float(result.people[whole].joints[12] @ result.scene.floor.normal + result.scene.floor.offset)
    assert neck - float(ankles.min()) > 1.0


def test_his_soles_touch_and_his_head_does_not(result: Reconstruction) -> None:
    whole, cut = whole_and_cut(result)
    model = load_body()
    contact = result.people[whole].contact
    for side in ("left", "right"):
        assert contact[model.contact_sets[f"{side}_sole"].numpy()].mean() > 0.5
    head = (model.part_of_vertex == model.part_names.index("head")).numpy()
    assert not contact[head].any()
    legs = [i for i, name in enumerate(model.part_names) if name.endswith(("lower_leg", "foot"))]
    unseen = np.isin(model.part_of_vertex.numpy(), legs)
    person = result.people[cut]
    least = ContactMethod().threshold - 1e-3  # float16
    assert (person.contact_probability[unseen & person.contact] >= least).all()
