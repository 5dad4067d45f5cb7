"""Stage 2: background alignment, human points, and bodies put back to where they truly are.

Keypoints and depth are those of the bodies at their true places.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.photo_content import PixelPoints
from physic_core.engine.placement.solve import (
    align_photo_points_to_scene,
    human_points,
    move_photo_points_to_scene,
    people_to_place,
)
from physic_core.geometry.camera import intrinsics_matrix, pixel_rays

from .drawn import normal

pytestmark = pytest.mark.quick

DEFAULT = engine_preset("default").placement
EVERY_POINT = replace(DEFAULT, max_points=10_000)
PAPER = engine_preset("paper").placement
AWAY = torch.tensor([[0.2, -0.1, 0.9], [-0.1, 0.1, -0.8]])


def people(
    stage, settings, away=AWAY, *, farther=1.0, feet_seen=(True, True), most=None, **changed
):
    """What places two people who were estimated away from where they are, by at most so many points
    of a depth that is too far by a factor; ``changed`` has other values of the state.
    """
    state = replace(stage.state, transl=stage.state.transl + away, **changed)
    rays = pixel_rays(*state.masks.shape[1:], state.K)
    points = rays * (farther * state.photo_depth)[..., None]
    valid = points[..., 2] > 0
    clouds = [human_points(points, valid, mask, settings)[:most] for mask in state.masks]
    return people_to_place(state, clouds, torch.tensor(feet_seen), settings)


def place(stage, settings=DEFAULT, away=AWAY, **changed):
    """How both were placed, and how far each is from its true place, cm."""
    fits = [settings.fit(person) for person in people(stage, settings, away, **changed)]
    return fits, 100 * (torch.stack([fit.x[:3] for fit in fits]) + away).norm(dim=-1)


def depth_offsets(fits):
    return [math.exp(fit.x[3]) for fit in fits]


def without_floor(stage):
    return replace(stage.state.scene, floor=None)


@pytest.mark.parametrize("larger", [1, 3])
def test_bodies_return_to_the_millimetre_at_any_resolution(two, larger):
    state = two.state
    K = larger * state.K
    K[:2, 2] += (larger - 1) / 2
    K[2, 2] = 1.0
    pictures = torch.cat((state.masks, state.photo_depth[None]))
    *masks, depth = pictures.repeat_interleave(larger, 1).repeat_interleave(larger, 2)
    fits, error_cm = place(
        two,
        scene=replace(without_floor(two), K=K),
        K=K,
        keypoints=larger * state.keypoints + (larger - 1) / 2,
        masks=torch.stack(masks) > 0,
        photo_depth=depth,
    )
    assert error_cm.max() < 0.1
    assert depth_offsets(fits) == [1.0, 1.0]


@pytest.mark.parametrize("seed", [0, 3])
def test_keypoints_far_outside_of_the_photo_send_no_body_to_infinity(two, seed):
    """The best fit to some of the keypoints and to points off by thousands of pixels is a body
    without a size.
    """
    keypoints = two.state.keypoints.clone()
    keypoints[1, :20] += 3000 * normal(20, 2, seed=seed).float()
    _, error_cm = place(two, keypoints=keypoints, scene=without_floor(two))
    assert error_cm[0] < 0.1
    assert error_cm[1] < 100


def test_people_who_are_seen_to_stand_keep_their_place_if_depth_is_too_far(two):
    fits, error_cm = place(two, farther=1.15)
    assert error_cm.max() < 0.5
    assert depth_offsets(fits) == pytest.approx([1 / 1.15, 1 / 1.15], rel=2e-3)
    fits, _ = place(two, farther=1.15, feet_seen=(True, False))
    assert depth_offsets(fits) == pytest.approx([1 / 1.15, 1.0], rel=2e-3)
    # Without the offset the points pull the body with them; the paper's sums all the way.
    assert place(two, farther=1.15, scene=without_floor(two))[1].min() > 4
    assert place(two, PAPER, farther=1.15)[1].min() > 40


def test_a_foot_in_the_air_is_not_pulled_down(two):
    scene = two.state.scene
    lower = replace(scene.floor, offset=scene.floor.offset + 0.8)
    assert place(two, scene=replace(scene, floor=lower))[1].max() < 3


@pytest.mark.parametrize("settings", [DEFAULT, PAPER])
def test_a_person_that_fails_does_not_change_the_other(two, settings):
    good, _ = place(two, settings)
    betas = two.state.betas.clone()
    betas[0] = math.nan
    fits, _ = place(two, settings, betas=betas)
    assert torch.equal(fits[1].x, good[1].x)
    assert not fits[0].x.any()
    assert "non-finite vertices" in fits[0].problem
    assert not fits[1].problem


def test_few_keypoints_leave_it_to_the_points(two):
    confidence = two.state.keypoint_confidence.clone()
    confidence[0, 2:] = 0.1
    near = torch.tensor([[0.02, 0.0, 0.1]]).expand(2, 3)
    given = {"keypoint_confidence": confidence, "scene": without_floor(two)}
    fits, error_cm = place(two, away=near, **given)
    assert fits[0].problem.startswith("2 joints")
    assert error_cm[0] < 2
    assert error_cm[1] < 0.1


def test_few_points_leave_it_to_the_keypoints(two):
    fits, error_cm = place(two, most=10, scene=without_floor(two))
    assert "10 points of depth" in fits[0].problem
    assert error_cm.max() < 0.1


def test_keypoints_that_no_place_explains_leave_the_body_in_front_of_the_camera(two):
    state = two.state
    mirrored = state.keypoints.mean(1, keepdim=True) * 2 - state.keypoints
    settings = replace(DEFAULT, chamfer_weight=0.0)
    fits, _ = place(two, settings, keypoints=mirrored, scene=without_floor(two))
    depth = state.transl[:, 2] + AWAY[:, 2] + torch.stack([fit.x[2] for fit in fits])
    assert (depth > 0.1).all()


ROWS = 90
COLUMNS = 120
ZERO = torch.zeros((), dtype=torch.float64)
RAYS = pixel_rays(ROWS, COLUMNS, intrinsics_matrix(100.0, 100.0, 59.5, 44.5, ZERO))
PERSON = torch.zeros((ROWS, COLUMNS), dtype=torch.bool)
PERSON[20:80, 45:75] = True
BACKGROUND = (1.5 / RAYS[..., 1].clamp(min=0.05)).clamp(max=6.0)
SCENE = RAYS * BACKGROUND[..., None]
EVERYWHERE = torch.ones_like(PERSON)
CAMERA = intrinsics_matrix(150.0, 150.0, 59.5, 44.5, ZERO)


def align(points, scene, people=PERSON, method=DEFAULT, **options):
    """Align a photo of unknown scale to a scene, both valid everywhere."""
    photo = PixelPoints(points, EVERYWHERE, "scale")
    return align_photo_points_to_scene(photo, people, scene, EVERYWHERE, method, **options)


def test_the_photo_is_aligned_outside_its_people_and_carries_them_along():
    photo = torch.where(PERSON, 2.0, BACKGROUND)
    relative = RAYS * (photo / 3.0)[..., None]
    # The network smears the person's rim, beyond the mask.
    relative[18:82, 43:77] *= torch.where(PERSON[18:82, 43:77], 1.0, 0.6)[..., None]
    found = align(relative, SCENE)
    assert found.scale == pytest.approx(3.0)
    assert found.inlier_share > 0.95
    placed = move_photo_points_to_scene(relative, found, CAMERA)
    assert_close(placed[PERSON][:, 2], torch.full_like(placed[PERSON][:, 2], 2.0))


def test_where_two_maps_disagree_the_background_at_the_peoples_depth_decides():
    photo = torch.where(PERSON, 4.2, BACKGROUND)
    # the far wall, most of the picture, came out farther
    photo = torch.where(photo > 5, photo * 1.3, photo)
    assert float((photo > 5).double().mean()) > 0.5
    for settings, scale in ((DEFAULT, 1.0), (PAPER, 1 / 1.3)):
        found = align(RAYS * photo[..., None], SCENE, method=settings)
        assert found.scale == pytest.approx(scale, abs=0.01)


def test_points_that_float_at_the_rim_are_no_human_points():
    depth = torch.where(PERSON, 2.0, 5.0).double()
    depth[20:80, 45] = 3.0  # mixed pixels inside the mask
    valid = EVERYWHERE.clone()
    valid[48:51, 58:61] = False
    depth[48:51, 58:61] = 2.01
    points = human_points(RAYS * depth[..., None], valid, PERSON, EVERY_POINT)
    assert points[:, 2].unique().tolist() == [2.0]
    assert len(points) > 0.8 * int(PERSON.sum())
