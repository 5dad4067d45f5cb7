"""The joint optimisation puts people where they belong, on floors and seats, out of surfaces, and
lets be the rest.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
import torch

from physic_core import engine_preset
from physic_core.body import JOINT_INDEX
from physic_core.engine.joint.energy import JointEnergy
from physic_core.engine.joint.method import JointStageMethod
from physic_core.engine.joint.solve import optimize
from physic_core.engine.joint.terms.scene_contact import lowest_height
from physic_core.errors import PhysicError
from physic_core.geometry.camera import project
from physic_core.geometry.rotvecs import rotvec_to_rotmat
from physic_paper.paper import PaperJointStage
from physic_paper.published import UnwhitenedVariables

from .adjusted import (
    adjusted,
    heights,
    in_float64,
    larger_scene,
    with_options,
    with_scene,
    without_joints,
)
from .conftest import FLOOR_Y
from .drawn import normal
from .test_views import view_of

pytestmark = pytest.mark.kernels

SETTINGS = engine_preset("default").joint
SHORT = adjusted(SETTINGS, optimiser__steps=20)
SITTING = {
    "left_hip": (-1.5, 0.0, 0.1),
    "right_hip": (-1.5, 0.0, -0.1),
    "left_knee": (1.5, 0.0, 0.0),
    "right_knee": (1.5, 0.0, 0.0),
}


def moved(state, *, by=(0.0, 0.0, 0.0), turn=0.0, seed=0):
    """The problem with its people shifted by metres, and every joint turned at random by so many
    radians.
    """
    noise = turn * normal(len(state), 54, 3, seed=seed).float()
    rotations = torch.cat(
        [state.rotations[:, :1], state.rotations[:, 1:] @ rotvec_to_rotmat(noise)], 1
    )
    return replace(state, transl=state.transl + torch.tensor(by), rotations=rotations)


def error_mm(result, stage):
    return (result.vertices - stage.vertices).norm(dim=-1).mean(1) * 1e3


def sole_mm(result):
    """Lowest vertex over the floor."""
    return heights(result).amin(1) * 1e3


def lowest_sole_m(result):
    """Height of the lower sole over the floor."""
    soles = [result.model.contact_sets[f"{side}_sole"] for side in ("left", "right")]
    return min(float(lowest_height(heights(result)[:, sole])) for sole in soles)


@pytest.mark.parametrize("lift", [0.0, -0.08, 0.05], ids=["true", "floating 8 cm", "sunk 5 cm"])
def test_a_person_who_stands_floats_or_sinks_ends_on_the_floor(standing, lift):
    result = optimize(moved(standing.state, by=(0.0, lift, 0.0)), SETTINGS)
    assert abs(sole_mm(result)) < 5
    assert error_mm(result, standing) < 5
    assert abs(lowest_sole_m(result)) < 0.005
    assert result.joint.failures == ("",)


def test_a_noisy_start_comes_close(standing):
    start = moved(standing.state, by=(0.0, 0.0, 0.3), turn=0.05)
    assert error_mm(optimize(start, SETTINGS), standing) < 40


def seat_of(stage):
    model = stage.state.model
    below = torch.cat([model.contact_sets["gluteus"], model.contact_sets["thighs"]])
    return stage.vertices[0, below, 1].amax().item()


@pytest.mark.parametrize("lift", [-0.06, 0.06], ids=["over the seat", "in the seat"])
def test_a_sitter_ends_on_the_seat(make_stage, lift):
    people = [(SITTING, (0.0, 0.0, 3.0))]
    seat = seat_of(make_stage(people))
    stage = make_stage(people, boxes=[((-0.4, seat, 2.7), (0.4, 1.3, 3.3))])
    result = optimize(moved(stage.state, by=(0.0, lift, 0.0)), SETTINGS)
    gap = seat * result.unapplied_scene_scale - seat_of(replace(stage, vertices=result.vertices))
    assert abs(gap) < 0.025


def test_legs_hidden_by_a_box_are_not_pushed_out_of_it(behind_box):
    """The box's front is all that the camera knows of it, and the legs are right behind."""
    stage = behind_box
    aware = optimize(stage.state, SHORT)
    blind = optimize(stage.state, adjusted(SHORT, visibility__occlusion_aware=False))
    legs = stage.vertices[0, :, 1] > 0.7
    energy = JointEnergy(stage.state, SHORT)
    assert energy.snapshot.visibility.hidden[0][legs[energy.sampling.ids]].float().mean() > 0.9
    assert error_mm(aware, stage) < 5
    assert error_mm(blind, stage) > 5 * error_mm(aware, stage)


def test_a_foot_in_the_air_stays_there(make_stage):
    stage = make_stage([({"left_hip": (-1.0, 0, 0), "left_knee": (1.2, 0, 0)}, (0.0, 0.0, 3.5))])
    sole = stage.state.model.contact_sets["left_sole"]
    start = FLOOR_Y - stage.vertices[0, sole, 1].amax().item()
    result = optimize(stage.state, SETTINGS)
    end = FLOOR_Y - result.vertices[0, sole, 1].amax().item()
    assert end == pytest.approx(start, abs=0.015)
    assert start > 0.1
    assert abs(sole_mm(result)) < 8


def test_a_person_on_a_step_is_not_pulled_to_the_floor(make_stage):
    stage = make_stage(
        [({}, (0.0, 0.0, 3.5))], boxes=[((-0.5, 1.12, 3.1), (0.5, 1.3, 4.0))], stands_at=1.12
    )
    result = optimize(stage.state, SETTINGS)
    assert error_mm(result, stage) < 15


UPPER_BODY = [
    JOINT_INDEX[name] for name in ("pelvis", "spine3", "neck", "head", "left_wrist", "right_wrist")
]


def test_legs_that_the_photo_does_not_show_feel_no_floor(standing):
    """A floor drawn through the shins, and a person who is cut at the hips: nothing there may pull
    or push.
    """
    state = standing.state
    cut = with_scene(without_joints(state, "knee", "ankle", "foot"), floor_offset=0.9)
    apart = (optimize(cut, SETTINGS).joints - standing.joints)[:, UPPER_BODY].norm(dim=-1).mean()
    assert float(apart) < 0.01


def test_depth_that_disagrees_with_the_floor_goes_into_the_offset(standing):
    state = replace(standing.state, photo_depth=1.15 * standing.state.photo_depth)
    result = optimize(state, SETTINGS)
    assert result.joint.depth_offset[0].item() == pytest.approx(-math.log(1.15), abs=0.04)
    assert error_mm(result, standing) < 60
    tied = optimize(state, adjusted(SHORT, depth__offset_sigma=0.0))
    assert error_mm(tied, standing) > 2 * error_mm(result, standing)


def test_known_bodies_correct_the_scale_of_the_scene(standing):
    """A scene that came out 12 % too large shrinks until its people stand in it."""
    large = larger_scene(standing.state, 1.12)
    result = optimize(large, SETTINGS)
    assert result.unapplied_scene_scale == pytest.approx(1 / 1.12, abs=0.05)
    assert abs(lowest_sole_m(result)) < 0.005


def test_the_energy_does_not_depend_on_the_resolution(standing):
    state = moved(standing.state, by=(0.02, 0.03, 0.1))
    K = 2 * state.K
    K[:2, 2] += 0.5  # integer coordinates are pixel centres
    K[2, 2] = 1

    def twice(image):
        return image.repeat_interleave(2, -1).repeat_interleave(2, -2)

    scene = state.scene
    points, normals = (
        twice(x.permute(2, 0, 1)).permute(1, 2, 0) for x in (scene.points, scene.normals)
    )
    fine = replace(
        with_scene(state, points=points, normals=normals, valid=twice(scene.valid)),
        K=K,
        keypoints=2 * state.keypoints + 0.5,
        masks=twice(state.masks),
        photo_depth=twice(state.photo_depth),
    )
    coarse_terms = JointEnergy(state, SETTINGS)()
    fine_terms = JointEnergy(fine, SETTINGS)()
    for name, value in coarse_terms.items():
        assert fine_terms[name].item() == pytest.approx(value.item(), rel=0.03, abs=0.02), name


def energy_with_all(stage, settings):
    """The energy of people, box, floor, depth, stated leans, faces and views, beside its start."""
    leaning = moved(stage.state, by=(0.01, 0.02, 0.05), turn=0.05)
    views = tuple(view_of(stage, turn) for turn in (40.0, 120.0)) if settings is SETTINGS else ()
    stands = torch.tensor([[0.9, 0.5], [0.6, 0.0]])
    lean = torch.tensor([0.05, 0.1])
    heads = {"head": torch.tensor([[0.6, 0.0, -0.8], [0.0, 0.6, -0.8]]), "head_sigma": lean}
    told = {"lean_sigma": lean, "stand_probability": stands, "views": views, **heads}
    state = in_float64(replace(leaning, **told))
    # Nearest points and signs may switch between two evaluations: hold them, as a line search does.
    energy = JointEnergy(state, with_options(settings, finds_nearest_every_step=False))
    here = energy.variables.pack()
    size = 1e-3 if isinstance(energy.variables, UnwhitenedVariables) else 0.05
    energy.variables.load(here + size * normal(len(here)))
    return energy


def test_no_term_of_the_default_energy_is_zero_everywhere(with_box):
    energy = energy_with_all(with_box, SETTINGS)
    energy.variables.values["pose"].data[:, :] += 1.0  # beyond the limits of knees and elbows
    positive = {name for name, value in energy().items() if bool((value > 0).any())}
    terms = {f.name for f in fields(SETTINGS)} - {f.name for f in fields(JointStageMethod)}
    assert terms - {"optimiser", "scene_scale"} | {"scale", "views"} == positive


@pytest.mark.parametrize(
    "settings",
    [SETTINGS, *(engine_preset(name).joint for name in ("paper", "release", "prox"))],
    ids=["default", "paper", "release", "prox"],
)
def test_gradient_of_the_whole_energy(with_box, settings):
    """Along random directions, against differences, in float64, with people, box, floor and depth
    all in play.
    """
    energy = energy_with_all(with_box, settings)
    # The nearest neighbours of the paper's depth are found at every evaluation.
    held = {"depth"} if isinstance(settings, PaperJointStage) else set()

    def terms(*parameters):
        found = energy().items()
        return [value for name, value in found if value.requires_grad and name not in held]

    parameters = energy.variables.parameters()
    assert torch.autograd.gradcheck(terms, parameters, fast_mode=True, rtol=1e-4, atol=1e-5)


def test_a_person_whose_energy_is_no_number_stays_and_the_others_go_on(two):
    """Finite numbers that overflow once they are squared."""
    betas = two.state.betas.clone()
    betas[0] = 1e30
    result = optimize(replace(two.state, betas=betas), SHORT)
    assert result.joint.failures == ("the energy of the start is not finite", "")
    assert error_mm(result, two)[1] < 5


def test_without_floor_and_scene_the_photo_alone_decides(standing):
    state = moved(standing.state, by=(0.05, 0.0, 0.2))
    state = with_scene(state, floor=None, valid=torch.zeros_like(state.scene.valid))
    result = optimize(state, SETTINGS)
    assert result.unapplied_scene_scale == 1.0
    assert error_mm(result, standing) < 30


def test_depth_without_its_data_is_refused(standing):
    state = replace(standing.state, photo_depth=None)
    with pytest.raises(PhysicError, match="the depth of the photo is missing"):
        optimize(state, SETTINGS)
    found = optimize(state, adjusted(SETTINGS.without("depth"), optimiser__steps=1))
    assert "depth" not in found.joint.losses


def test_a_small_person_under_the_floor_does_not_rescale_the_scene_of_two_large_ones(make_stage):
    stage = make_stage([({}, (-0.6, 0.0, 3.3)), ({}, (0.6, 0.0, 3.5)), ({}, (0.2, 0.0, 6.5))])
    state = stage.state
    # The body of the small one is as large as the others', and so 1.5 times as far as the floor at
    # these feet.
    feet = torch.stack([state.transl[2, 0], torch.tensor(FLOOR_Y), state.transl[2, 2]])
    transl = state.transl.clone()
    transl[2] += 0.5 * feet
    body = state.model(state.rotations, state.betas, transl)
    keypoints = project(state.model.landmarks(body, state.skeleton), state.K)
    result = optimize(replace(state, transl=transl, keypoints=keypoints), SETTINGS)
    assert result.unapplied_scene_scale == pytest.approx(1.0, abs=0.1)
    assert sole_mm(result)[:2].abs().max() < 30
