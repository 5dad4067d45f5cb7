"""Closed-form fits: each piece against a slow twin in float64, bodies recovered from their own
joints and surface.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch
from other_body import mm

from physic_convert.joint_fit import (
    BodyFit,
    fit_joints,
    has_torso_joints,
    rotations_from_joints,
)
from physic_convert.surface_fit import (
    SampledBodyModel,
    SurfaceTargets,
    fit_surface,
    sample_vertices,
)
from physic_core.body import JOINT_INDEX, JOINT_NAMES
from physic_core.body.bones import (
    BoneOffsets,
    rotations_from_parents,
    rotations_from_tpose,
)
from physic_core.geometry.rotations import rotmat_to_rotvec, rotvec_to_rotmat_numpy
from physic_core.geometry.tensors import exact_arrays

FINGERS = [name for name in JOINT_NAMES if name[-1].isdigit() and "spine" not in name]
SEEN = (12, 15, *range(16, 22), 1, 2, 4, 5, 7, 8)
"""Joints that pose networks see."""


def as_fit(people):
    return BodyFit(rotations_from_tpose(people["rotations"]), people["betas"], people["transl"])


def posed(model, fit):
    """Vertices and joints, by the model itself."""
    given = (
        torch.from_numpy(a).to(model.dtype)
        for a in (rotations_from_parents(fit.world), fit.betas, fit.transl)
    )
    out = model(*given)
    return exact_arrays(out.vertices, out.joints)


def turns_deg(found, truth):
    """Degrees between the world rotations (..., 3, 3) of two fits."""
    return np.degrees(np.linalg.norm(rotmat_to_rotvec(np.swapaxes(found, -1, -2) @ truth), axis=-1))


def test_a_body_is_recovered_from_its_joints_and_rotations(embedded, people):
    truth = as_fit(people)
    vertices, joints = posed(embedded, truth)
    found = fit_joints(BoneOffsets.of(embedded), joints, truth.world)
    again = posed(embedded, found)
    assert mm(again[1], joints) < 1.0
    assert mm(again[0], vertices) < 5
    # Only limbs were turned, and by little: what the shape leaves over.
    turns = turns_deg(found.world, truth.world)
    assert turns.max() < 1.5
    kept = [i for i in range(55) if i not in (1, 2, 4, 5, 16, 17, 18, 19)]
    assert turns[:, kept].max() < 1e-5


@pytest.mark.parametrize("unknown", [["left_hip"], ["neck", "right_shoulder"]])
def test_without_both_hips_and_shoulders_or_neck_there_is_no_trunk(unknown):
    known = np.ones((1, 55), bool)
    known[0, [JOINT_INDEX[name] for name in unknown]] = False
    assert not has_torso_joints(known)[0]


@pytest.mark.parametrize(
    ("unknown", "most_mm"),
    [
        ([], 9),
        (["spine1", "spine2", "spine3"], 12),
        (["left_foot", "right_foot", "left_eye", "right_eye", "jaw"], 18),
        ([name for name in FINGERS if "middle" not in name and "pinky" not in name], 18),
        (["left_elbow", "left_wrist", "right_ankle", "right_foot", *FINGERS[:15]], 120),
        (["neck", "left_collar", "right_collar"], 16),
        (["left_shoulder"], 30),
        ([name for i, name in enumerate(JOINT_NAMES) if i not in SEEN], 35),
    ],
    ids=["none", "spine", "ends", "fingers", "limbs", "neck", "shoulder", "what pose networks see"],
)
def test_joints_may_be_unknown(embedded, people, unknown, most_mm):
    vertices, joints = posed(embedded, as_fit(people))
    given_joints = joints.copy()
    given_joints[:, [JOINT_INDEX[name] for name in unknown]] = np.nan
    assert has_torso_joints(np.isfinite(given_joints).all(-1)).all()
    found = fit_joints(BoneOffsets.of(embedded), given_joints, None)
    again, there = posed(embedded, found)
    known = np.isfinite(given_joints).all(-1)
    assert np.isfinite(again).all()
    assert mm(there[known], joints[known]) < 10
    assert mm(again, vertices) < most_mm
    if not unknown:
        turns = turns_deg(found.world, as_fit(people).world)
        assert turns[:, [0, 9, 15]].max() < 6
        assert turns[:, :22].mean() < 6


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_bent_limbs_tell_how_they_are_turned(embedded, side, sign):
    """Known answer: a thigh turned about itself by 30 degrees shows in where the bent shin points;
    so does an arm.
    """
    bends = {"hip": (0, 30, 0), "knee": (80, 0, 0), "shoulder": (40, 0, 0)}
    bends["elbow"] = (0, -70 * sign, 0)
    degrees = np.zeros((1, 55, 3))
    for name, bend in bends.items():
        degrees[0, JOINT_INDEX[f"{side}_{name}"]] = bend
    truth = BodyFit(
        rotations_from_tpose(rotvec_to_rotmat_numpy(np.radians(degrees))),
        np.zeros((1, embedded.num_betas)),
        np.zeros((1, 3)),
    )
    bones = BoneOffsets.of(embedded)
    world = rotations_from_joints(bones.pose(*vars(truth).values()), bones.rest(truth.betas))
    turns = turns_deg(world, truth.world)[0]
    for name in bends:
        assert turns[JOINT_INDEX[f"{side}_{name}"]] < 4, name


def test_a_body_is_recovered_from_its_surface(embedded, people):
    truth = as_fit(people)
    vertices, joints = posed(embedded, truth)
    patches = SampledBodyModel.of(embedded, sample_vertices(embedded))
    points = vertices[:, patches.ids]
    errors = []
    targets = SurfaceTargets(points, np.ones(points.shape[:2]))
    for rounds in (2, 3):
        found = posed(embedded, fit_surface(patches, targets, rounds, sigma_m=0.001))
        errors.append((mm(found[0], vertices), mm(found[1], joints)))
    assert max(errors[0]) < 0.1
    assert errors[1][0] < 0.05
