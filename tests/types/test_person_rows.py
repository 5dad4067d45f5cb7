"""The row of a person, of which ``people.csv`` is made."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from physic_core.errors import InputError, PackageMissingError
from physic_core.types import (
    MARKS,
    BodyContact,
    ContactPartner,
    Support,
)
from physic_core.types.bodies import JOINT_INDEX
from physic_core.types.tables import PERSON_COLUMNS, person_rows


@pytest.fixture
def two_people(reconstruction):
    """Person 0, good, 3 m away; person 1, bad, a fifth as high in the photo, without a body."""
    near, far = reconstruction.people[:2]
    floor = ContactPartner("floor", "floor")
    other = ContactPartner("person", person=1, part="left_hand")
    contacts = (BodyContact("left_foot", floor, 0.9, 20), BodyContact("seat", other, None, 9))
    near = replace(
        near,
        box=np.array([10.0, 0.0, 30.0, 100.0]),
        trust=0.91,
        trust_pose=0.92,
        trust_place=0.79,
        why="no check lowers it much",
        joints=np.broadcast_to([0.0, 1.8, 2.4], near.joints.shape),
        stature=1.7234,
        stature_sigma=0.05,
        posture="sit",
        posture_probability=0.87,
        contacts=(
            *contacts,
            BodyContact("right_foot", floor, 0.49, 20),
            BodyContact("left_lower_leg", floor, 0.8, 9, assumed=True),
        ),
        unseen=("left_lower_leg", "left_foot"),
        joint_sigma=np.where(np.arange(55) == JOINT_INDEX["right_wrist"], np.nan, 0.3),
        sizes={"pelvis_height_m": 0.90012},
        parameters=replace(
            near.parameters, body_pose=np.where(np.arange(63) == 9, np.pi / 3, 0)[None]
        ),
    )
    far = replace(
        far,
        box=np.array([50.0, 0.0, 55.0, 20.0]),
        trust=0.0,
        why="Leans: 50° (see the view from the side)",
        joints=np.full_like(far.joints, np.nan),
        contacts=(),
        parameters=replace(far.parameters, body_pose=np.full((1, 63), np.nan)),
        sizes={},
    )
    camera = replace(reconstruction.intrinsics, trust="known")
    return replace(reconstruction, people=(near, far), intrinsics=camera)


NUMBERS = [name for name in PERSON_COLUMNS if name.endswith(("height_m", "_deg"))]
SIGMAS = [name for name in PERSON_COLUMNS if name.endswith(("arm_sigma_m", "leg_sigma_m"))]
UPRIGHT = {name: 0.0 for name in NUMBERS if name.endswith("_deg")}
TRUST_OF_MARKS = {f"trust_{mark}": None for mark in MARKS}
ARMS = {f"{side}_shoulder_elevation_deg": 90.0 for side in ("left", "right")}  # of the T-pose


def test_a_row_says_where_a_person_is_and_what_is_known(two_people):
    first, second = person_rows(two_people)
    assert first == {
        "person": 0,
        "usable": "pose, place",
        "trust": 0.91,
        **TRUST_OF_MARKS,
        "trust_pose": 0.92,
        "trust_place": 0.79,
        "why": "no check lowers it much",
        "body_source": None,
        "distance_m": 3.0,
        "distance_sigma_m": 0.21,
        "stature_m": 1.723,
        "stature_sigma_m": 0.086,
        "posture": "sit",
        "posture_probability": 0.87,
        "child_probability": None,
        "contacts": "left foot: floor, 0.90; buttocks: left hand of person 1",
        "assumed": "left lower leg: floor, 0.80 (assumed: hidden)",
        "unseen": "left lower leg, left foot",
        "unsure": "left arm, right leg",
        **dict.fromkeys(SIGMAS, 0.3),
        "right_arm_sigma_m": None,
        **dict.fromkeys(NUMBERS),
        **UPRIGHT,
        **ARMS,
        "pelvis_height_m": 0.9,
        "left_knee_flexion_deg": 60.0,
    }
    assert second == dict.fromkeys(PERSON_COLUMNS) | {
        "person": 1,
        "usable": "",
        "trust": 0.0,
        "why": "Leans: 50° (see the view from the side)",
        **dict.fromkeys(("contacts", "assumed", "unseen", "unsure"), ""),
    }
    assert all(list(row) == list(PERSON_COLUMNS) for row in (first, second))


def test_two_surfaces_of_one_class_are_told_apart_in_rows_and_support(
    reconstruction,
):
    water, pool, seat = (
        ContactPartner("scene", name, id) for name, id in (("water", 0), ("water", 4), ("seat", 2))
    )
    touched = {"left_foot": water, "right_foot": pool, "seat": seat}
    contacts = tuple(BodyContact(part, partner, 0.9, 20) for part, partner in touched.items())
    person = replace(reconstruction.people[0], contacts=contacts)
    row = person_rows(replace(reconstruction, people=(person,)))[0]
    assert (
        row["contacts"]
        == "left foot: water 0, 0.90; right foot: water 4, 0.90; buttocks: seat, 0.90"
    )
    support = Support("balanced", contacts, None, (0.0, 0.0, 1.0))
    assert str(support) == "balanced: left foot on water 0, right foot on water 4, buttocks on seat"


def test_a_frame_of_pandas_has_the_rows_of_people(two_people):
    pandas = pytest.importorskip("pandas")
    frame = two_people.to_pandas()
    pandas.testing.assert_frame_equal(frame, pandas.DataFrame(person_rows(two_people)))
    assert list(frame.columns) == list(PERSON_COLUMNS)


def test_joints_and_the_floor_have_names(two_people):
    person = two_people.people[0]
    np.testing.assert_array_equal(person.joint("left_knee"), person.joints[4])
    with pytest.raises(InputError, match="left_knee"):
        person.joint("knee")
    assert person.unseen_joints == ("left_knee", "left_ankle")
    assert two_people.floor is two_people.scene.floor


def test_pandas_that_is_not_installed_is_named(two_people, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(PackageMissingError, match="pip install pandas"):
        two_people.to_pandas()
