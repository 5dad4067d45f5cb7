"""What photos do not show."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from physic_core import engine_preset
from physic_core.body.joints import JOINT_INDEX
from physic_core.engine.joint.context import STATIC_CONTACT_PARTS
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms import picture
from physic_core.engine.joint.terms.surface import SurfaceTerms
from physic_core.engine.limbs import keypoints_of_observed_limbs
from physic_core.geometry.rotations import rotvec_to_rotmat
from physic_core.types import SKELETONS

from .adjusted import adjusted, term_of

SETTINGS = engine_preset("default").joint
NAMES = SKELETONS["blazepose33"].names


@pytest.mark.parametrize(
    ("changes", "share"),
    [
        ({"contact__static_weight": 0.25}, 0.25),
        ({"contact__static_weight": 0.0}, 0.0),
        ({"contact__static_weight": 0.0, "contact__source": "static"}, 1.0),
    ],
)
def test_usual_contact_parts_count_without_a_prior(standing, changes, share):
    nobody = replace(standing.problem, contact_probability=0 * standing.problem.contact_probability)
    energy = JointEnergy(nobody, adjusted(SETTINGS, **changes))
    prior = term_of(energy, SurfaceTerms).contact.prior
    likely = torch.zeros(nobody.model.num_vertices, dtype=torch.bool)
    for name in STATIC_CONTACT_PARTS:
        likely[nobody.model.contact_sets[name]] = True
    torch.testing.assert_close(prior[0], share * likely[energy.context.ids].float())


def test_the_prior_goes_before_likely_parts(standing):
    prior, both = (
        term_of(JointEnergy(standing.problem, settings), SurfaceTerms).contact.prior
        for settings in (
            adjusted(SETTINGS, contact__static_weight=weight) for weight in (0.0, 0.25)
        )
    )
    assert (prior > 0).any()
    torch.testing.assert_close(both[prior > 0], prior[prior > 0])


def lifted(stage, height):
    """The left foot ``height`` metres over the floor, and the photo shows neither knee nor ankle of
    that leg.
    """
    observed = stage.problem.observed.clone()
    for name in ("knee", "ankle", "foot"):
        observed[:, JOINT_INDEX[f"left_{name}"]] = False
    bend = torch.acos(torch.tensor(1 - height / 0.8))
    pose = stage.problem.rotations0.clone()
    for joint, turn in (("left_hip", -bend), ("left_knee", 2 * bend), ("left_ankle", -bend)):
        c = torch.cos(turn)
        s = torch.sin(turn)
        about_x = torch.tensor([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        pose[:, JOINT_INDEX[joint]] = pose[:, JOINT_INDEX[joint]] @ about_x
    return replace(stage.problem, observed=observed, rotations0=pose)


def sole_height(problem, vertices):
    """Metres of the lowest vertex of the left sole over the floor."""
    sole = vertices[0, problem.model.contact_sets["left_sole"]]
    return float((sole @ problem.floor_normal + problem.floor_offset).min())


def test_an_unseen_foot_that_hovers_comes_down(standing, monkeypatch):
    monkeypatch.setattr(picture, "INVISIBLE_WEIGHT", 0.0)
    problem = lifted(standing, 0.06)
    start = problem.model(
        problem.rotations0, problem.betas0, problem.transl0, problem.expression0
    ).vertices
    assert 0.03 < sole_height(problem, start) < 0.1
    pulled, left = (
        sole_height(
            problem, optimize(problem, adjusted(SETTINGS, soles__unseen_weight=weight)).vertices
        )
        for weight in (SETTINGS.soles.unseen_weight, 0.0)
    )
    assert pulled < left - 0.02
    assert left > 0.03


def test_guessed_keypoints_count_by_their_own_weight(standing, monkeypatch):
    monkeypatch.setattr(picture, "INVISIBLE_WEIGHT", 0.5)
    problem = lifted(standing, 0.06)
    hidden = ~keypoints_of_observed_limbs(problem.skeleton, problem.observed)
    assert hidden.sum() >= 2
    guessed = replace(problem, keypoint_confidence=torch.where(hidden, 0.1, 1.0))
    context = JointEnergy(guessed, SETTINGS).context
    expected = torch.where(hidden, 0.05, 1.0) * torch.tensor(
        [0.5 if name.endswith("_hip") else 1.0 for name in NAMES]
    )
    torch.testing.assert_close(context.keypoints.weight.to(expected), expected)


def test_guessed_keypoints_bring_a_hidden_foot_back(standing, monkeypatch):
    """A leg that nobody sees is 7 degrees too far to the side, its ankle 10 cm."""
    problem = lifted(standing, 0.0)
    hip = JOINT_INDEX["left_hip"]
    ankle = JOINT_INDEX["left_ankle"]
    posed = problem.model(problem.rotations0, problem.betas0, problem.transl0, problem.expression0)
    aside = problem.rotations0.clone()
    aside[:, hip] = aside[:, hip] @ rotvec_to_rotmat(torch.tensor([0.0, 0.0, 0.12]))

    def off(weight):
        monkeypatch.setattr(picture, "INVISIBLE_WEIGHT", weight)
        end = optimize(replace(problem, rotations0=aside), SETTINGS).joints
        return float((end - posed.joints)[0, ankle].norm())

    assert off(0.0) > 0.08
    assert off(0.4) < 0.03


def test_an_unseen_foot_high_up_is_let_go(standing):
    assert JointEnergy(lifted(standing, 0.06), SETTINGS).weights["unseen_soles"].tolist() == [
        [1.0, 0.0]
    ]
    assert JointEnergy(lifted(standing, 0.35), SETTINGS).weights["unseen_soles"].tolist() == [
        [0.0, 0.0]
    ]


def test_a_person_without_a_floor_may_be_nearer_than_depth_says(standing):
    problem = replace(standing.problem, floor_normal=None)
    assert "offset" in JointEnergy(problem, SETTINGS).state.free
    tied = JointEnergy(problem, adjusted(SETTINGS, depth__offset_alone_sigma=0.0))
    assert "offset" not in tied.state.free
