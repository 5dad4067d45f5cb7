"""What ``physic run`` and ``physic show`` print of people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physic_core import save_reconstruction
from physic_core.types import (
    BodyContact,
    CheckResult,
    CheckState,
    ContactPartner,
    UnposedPerson,
)


def check(name, state, value, label):
    return CheckResult(name, state, value, 0.035, "at most", "share", "", 1, label=label)


TOLD = ("the size is a guess", "it was rotated", "give --age", "is it turned?", "a default")


@pytest.fixture
def folder(make, tmp_path):
    made = make()
    floor = ContactPartner("floor", "floor")
    own = ContactPartner("self", person=0, part="head")
    contacts = (
        BodyContact("left_foot", floor, 0.9, 200),
        BodyContact("right_hand", own, 0.8, 9),
        BodyContact("left_lower_leg", floor, 0.8, 9, assumed=True),
    )
    why = "Limbs far from their keypoints: 4.5 % (check the overlay)"
    doubtful = {"trust_place": 0.5, "failed_checks": ("limb_keypoints", "lean")}
    places = ([0.0, 1.8, 2.4], [0.0, 0.0, 12.5], [np.nan] * 3)
    first, second, third = (
        replace(
            made.people[0],
            contacts=(),
            joints=np.broadcast_to(place, made.people[0].joints.shape),
        )
        for place in places
    )
    people = (
        replace(
            first,
            trust_place=0.914,
            trust_pose=0.2,
            why="look at the arms",
            contacts=contacts,
            unseen=("left_lower_leg", "right_lower_leg", "left_foot"),
        ),
        replace(second, why=why, **doubtful),
        third,
    )
    failed = CheckState.FAILED
    checks = (
        check("limb_keypoints", failed, 0.045, "Limbs far from their keypoints"),
        check("lean", failed, 0.5, "Lean angle"),
        replace(check("support", CheckState.UNKNOWN, None, "Supported"), person=2),
    )
    unposed = (UnposedPerson((1.0, 2.0, 30.0, 40.0), 0.5, "only a hand is seen"),)
    told = {"checks": checks, "notes": TOLD}
    result = replace(made, people=people, unposed=unposed, contact_partners=(), **told)
    save_reconstruction(result, tmp_path / "out", "numbers")
    return tmp_path / "out"


def test_a_person_is_described_by_marks_contact_and_reasons(folder, physic):
    lines = physic("show", folder).stdout.splitlines()
    assert lines[1:9] == [
        "person 0: 3.0 ± 0.2 m away, place usable; pose doubtful",
        "  contact: left foot: floor, 0.90; right hand: own head, 0.80; "
        "left lower leg: floor, 0.80 (assumed: hidden)",
        "  not visible: both lower legs, left foot",
        "  why: look at the arms",
        "person 1: 12.5 ± 0.9 m away, place doubtful",
        "  contact: none",
        "  why: Limbs far from their keypoints: 4.5 % (check the overlay)",
        "person 2: no body, not judged",
    ]
    assert "no body: only a hand is seen; box 1, 2, 30, 40, score 0.50" in lines
    assert "pose usable for 0 of 3 people, place for 1, contact for 0, size for 0" in lines


def test_three_notes_are_shown_and_those_that_leave_something_to_do_come_first(folder, physic):
    def shown(*options):
        lines = physic("show", folder, *options).stdout.splitlines()
        return [line[6:] for line in lines if line.startswith("note: ")]

    assert shown() == ["give --age", "is it turned?", "the size is a guess"]
    assert f"physic show {folder} --notes" in physic("show", folder).stdout
    assert sorted(shown("--notes")) == sorted(TOLD)
