"""Stage 2: background alignment, human points, and bodies put back to where they truly are.

The body is an ellipsoid of a person's size: its picture and its points are known in closed form.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.photo import PixelPoints
from physic_core.engine.placement import method, terms
from physic_core.engine.placement.solve import (
    align_photo_points_to_scene,
    human_points,
    move_photo_points_to_scene,
)
from physic_core.engine.placement.terms import (
    PlacementProblem,
    closed_form_translation,
    gauss_newton,
)
from physic_core.geometry.camera import intrinsics_matrix, pixel_rays, project
from physic_paper import outliers

from .conftest import plane_of
from .drawn import normal, uniform

pytestmark = pytest.mark.quick

DEFAULT = engine_preset("default").placement
EVERY_POINT = replace(DEFAULT, max_points=10_000)
PAPER = engine_preset("paper").placement
AXES = torch.tensor([0.25, 0.85, 0.15], dtype=torch.float64)
UP = torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)


def sphere(count=2500):
    """(count, 3) points spread evenly over the unit sphere."""
    k = torch.arange(count, dtype=torch.float64) + 0.5
    polar = torch.acos(1 - 2 * k / count)
    turn = math.pi * (1 + math.sqrt(5)) * k
    return torch.stack((polar.sin() * turn.cos(), polar.cos(), polar.sin() * turn.sin()), -1)


VERTICES = sphere() * AXES
NORMALS = normalize(sphere() / AXES, dim=-1)
JOINTS = 2 * uniform(17, 3, seed=1) - 1
LANDMARKS = JOINTS * torch.tensor([0.2, 0.75, 0.1])
SOLES = (VERTICES[:, 1] > 0.8).nonzero()[:, 0]
TRUE = torch.tensor([[0.3, 0.45, 4.0], [-0.9, 0.45, 5.0]], dtype=torch.float64)
START = TRUE + torch.tensor([[0.2, -0.1, 0.9], [-0.1, 0.1, -0.8]])
FLOOR_M = 0.45 + 0.85
FLOOR = plane_of(UP, FLOOR_M)


class Placed(NamedTuple):
    """Places (2, 3) of two people, metres, and how each was found."""

    transl: Tensor
    fits: list[method.Fit]


class Picture:
    """Two ellipsoids seen by a camera of a given width."""

    def __init__(self, columns=320, farther=1.0, settings=DEFAULT):
        rows = columns * 3 // 4
        focal = 0.8 * columns
        self.K = intrinsics_matrix(focal, focal, (columns - 1) / 2, (rows - 1) / 2, TRUE[0, 0])
        rays = pixel_rays(rows, columns, self.K)
        masks = []
        self.points = []
        for centre in TRUE:
            a = ((rays / AXES) ** 2).sum(-1)
            b = -(rays / AXES * (centre / AXES)).sum(-1)
            inside = b**2 - a * (((centre / AXES) ** 2).sum() - 1)
            masks.append(inside > 0)
            near = (-b - inside.clamp(min=0).sqrt()) / a
            self.points.append(
                human_points(rays * (near * farther)[..., None], inside > 0, inside > 0, settings)
            )
        self.masks = torch.stack(masks)
        self.keypoints = project(LANDMARKS + TRUE[:, None], self.K)
        self.confidence = torch.ones(2, 17, dtype=torch.float64)

    def person(self, i, start, floor=None):
        body = VERTICES + start[i]
        return PlacementProblem(
            landmarks=LANDMARKS + start[i],
            keypoints=self.keypoints[i],
            confidence=self.confidence[i],
            size=torch.full((2,), 200.0, dtype=torch.float64),
            vertices=body,
            normals=NORMALS,
            outer=torch.ones(len(body), dtype=torch.bool),
            points=self.points[i],
            mask=self.masks[i],
            soles=body[:0] if floor is None else body[SOLES],
            floor=floor,
            K=self.K,
            row=i,
            people=2,
        )

    def place(
        self, settings=DEFAULT, start=START, *, floor=None, feet_seen=(True, True), **changed
    ):
        """Place both people; ``changed`` has other values (2, ...) of their problems."""
        fits = []
        for i, seen in enumerate(feet_seen):
            own = {k: v[i] for k, v in changed.items()}
            person = self.person(i, start, floor if seen else None)._replace(**own)
            fits.append(settings.fit(settings.observe(person)))
        return Placed(start + torch.stack([fit.x[:3] for fit in fits]), fits)


def depth_offsets(placed):
    return [math.exp(fit.x[3]) for fit in placed.fits]


def error_cm(placement):
    return 100 * (placement.transl - TRUE).norm(dim=-1)


@pytest.mark.parametrize("columns", [160, 320, 800])
def test_bodies_return_to_the_millimetre_at_any_resolution(columns):
    placed = Picture(columns).place()
    assert error_cm(placed).max() < 0.1
    assert depth_offsets(placed) == [1.0, 1.0]


@pytest.mark.parametrize("seed", [0, 3])
def test_keypoints_far_outside_of_the_photo_send_no_body_to_infinity(seed):
    """The best fit to half of the keypoints and to points off by thousands of pixels is a body
    without a size.
    """
    picture = Picture()
    picture.keypoints[1, :9] += 3000 * normal(9, 2, seed=seed)
    placed = picture.place()
    assert error_cm(placed)[0] < 0.1
    assert error_cm(placed)[1] < 100


def test_people_who_are_seen_to_stand_keep_their_place_if_depth_is_too_far():
    picture = Picture(160, farther=1.15)
    stands = picture.place(floor=FLOOR)
    assert error_cm(stands).max() < 0.5
    assert depth_offsets(stands) == pytest.approx([1 / 1.15, 1 / 1.15], rel=2e-3)
    lowest = (VERTICES + stands.transl[0])[SOLES, 1].max()
    assert FLOOR_M - lowest == pytest.approx(0.0, abs=0.01)
    one = picture.place(floor=FLOOR, feet_seen=(True, False))
    assert depth_offsets(one) == pytest.approx([1 / 1.15, 1.0], rel=2e-3)
    # Without the offset the points pull the body with them; the paper's sums all the way.
    assert error_cm(picture.place()).min() > 10
    assert error_cm(Picture(160, farther=1.15, settings=PAPER).place(PAPER)).min() > 40


def test_a_foot_in_the_air_is_not_pulled_down():
    high = plane_of(UP, FLOOR_M + 0.8)
    assert error_cm(Picture().place(floor=high)).max() < 3


@pytest.mark.parametrize("settings", [DEFAULT, PAPER])
def test_a_person_that_fails_does_not_change_the_other(settings):
    picture = Picture(160, settings=settings)
    good = picture.place(settings).transl[1]
    broken = VERTICES + START[:, None]
    broken[0, 7] = math.nan
    placed = picture.place(settings, vertices=broken)
    assert torch.equal(placed.transl[1], good)
    assert torch.equal(placed.transl[0], START[0])
    assert "non-finite vertices" in placed.fits[0].problem
    assert not placed.fits[1].problem


def test_few_keypoints_leave_it_to_the_points():
    picture = Picture()
    picture.confidence[0, 2:] = 0.1
    picture.keypoints[0, 5] = math.nan
    near = TRUE + torch.tensor([0.02, 0.0, 0.1])
    placed = picture.place(start=near)
    assert placed.fits[0].problem.startswith("2 joints")
    assert error_cm(placed)[0] < 2
    assert error_cm(placed)[1] < 0.1


def test_few_points_leave_it_to_the_keypoints():
    picture = Picture()
    picture.points[0] = picture.points[0][:10]
    placed = picture.place()
    assert placed.fits[0].problem.startswith("10 points ")
    assert error_cm(placed).max() < 0.1


def test_keypoints_that_no_place_explains_leave_the_body_in_front_of_the_camera():
    picture = Picture()
    picture.keypoints = picture.keypoints.mean(1, keepdim=True) * 2 - picture.keypoints
    placed = picture.place(replace(DEFAULT, chamfer_weight=0.0))
    assert torch.isfinite(placed.transl).all()
    assert (placed.transl[:, 2] > 0.1).all()


def subject():
    picture = Picture()
    picture.confidence = picture.confidence * torch.linspace(0.3, 1, 17)
    return picture.person(0, START, FLOOR)


@pytest.mark.parametrize("kind", ["reprojection_term", "chamfer_term", "floor_term"])
def test_slopes_are_the_derivatives_of_the_errors(kind):
    person = subject()
    front = person.vertices[:, 2] < START[0, 2] - 0.02
    given = (person, front) if kind == "chamfer_term" else (person,)
    term = getattr(DEFAULT, kind)(*given)
    x = torch.tensor([0.05, -0.1, 0.2, 0.07], dtype=torch.float64)
    step = 1e-7  # small enough that no nearest point changes
    for axis in range(4):
        ahead = x.clone()
        ahead[axis] += step
        for now, then in zip(term.residuals(x), term.residuals(ahead), strict=True):
            difference = (then.error - now.error) / step
            assert_close(difference, now.slope[..., axis], atol=1e-5, rtol=1e-5)


def test_closed_form_is_exact_for_exact_keypoints():
    person = subject()
    found = closed_form_translation(person)
    assert_close(found[:3] + START[0], TRUE[0], atol=1e-3, rtol=0)
    assert found[3] == 0


def test_descent_never_raises_the_energy_and_leaves_fixed_numbers_alone(
    monkeypatch,
):
    monkeypatch.setattr(terms, "ITERATIONS", 1)
    person = subject()
    term = replace(DEFAULT, robust_px_share=math.inf).reprojection_term(person)

    values = []
    x = torch.zeros(4, dtype=torch.float64)
    for _ in range(5):
        values.append(
            sum((r.weight * r.error.square().sum(-1)).sum().item() for r in term.residuals(x))
        )
        x = gauss_newton([term], x, (0, 2))
    assert values == sorted(values, reverse=True)
    assert (x[1], x[3]) == (0.0, 0.0)


ROWS = 90
COLUMNS = 120
RAYS = pixel_rays(ROWS, COLUMNS, intrinsics_matrix(100.0, 100.0, 59.5, 44.5, TRUE[0, 0]))
PERSON = torch.zeros((ROWS, COLUMNS), dtype=torch.bool)
PERSON[20:80, 45:75] = True
BACKGROUND = (1.5 / RAYS[..., 1].clamp(min=0.05)).clamp(max=6.0)
SCENE = RAYS * BACKGROUND[..., None]
EVERYWHERE = torch.ones_like(PERSON)
CAMERA = intrinsics_matrix(150.0, 150.0, 59.5, 44.5, TRUE[0, 0])


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


def test_far_background_takes_no_part_where_that_is_wanted():
    wrong = torch.where(BACKGROUND > 5, BACKGROUND * 1.5, BACKGROUND)
    found = align(RAYS * wrong[..., None], SCENE, far=5.0)
    assert (found.scale, found.inlier_share) == (pytest.approx(1.0), pytest.approx(1.0))


def test_aligned_points_are_put_on_the_rays_of_the_scenes_camera():
    found = align(SCENE / 2, SCENE)
    placed = move_photo_points_to_scene(SCENE / 2, found, CAMERA)
    expected = pixel_rays(ROWS, COLUMNS, CAMERA) * BACKGROUND[..., None]
    assert_close(placed, expected)


def test_without_a_common_background_no_person_has_points():
    found = align(SCENE, SCENE, people=EVERYWHERE)
    assert found.inlier_share == 0
    placed = move_photo_points_to_scene(SCENE, found, CAMERA)
    assert len(human_points(placed, EVERYWHERE, PERSON, DEFAULT)) == 0


def test_points_that_float_at_the_rim_are_no_human_points():
    depth = torch.where(PERSON, 2.0, 5.0).double()
    depth[20:80, 45] = 3.0  # mixed pixels inside the mask
    points = human_points(RAYS * depth[..., None], EVERYWHERE, PERSON, EVERY_POINT)
    assert points[:, 2].unique().tolist() == [2.0]
    assert len(points) > 0.85 * int(PERSON.sum())


def test_a_speck_of_background_in_the_mask_is_no_human_point(
    monkeypatch,
):
    depth = torch.where(PERSON, 2.0, 5.0).double()
    depth[50:52, 60:62] = 5.0
    monkeypatch.setattr(outliers, "KNN_SHARE", 0.1)
    for settings in (DEFAULT, PAPER):
        points = human_points(RAYS * depth[..., None], EVERYWHERE, PERSON, settings)
        assert points[:, 2].max() == 2.0


def test_no_more_points_than_the_limit_spread_over_the_person():
    points = human_points(RAYS * 2.0, EVERYWHERE, PERSON, replace(DEFAULT, max_points=100))
    assert points.shape == (100, 3)
    every = human_points(RAYS * 2.0, EVERYWHERE, PERSON, EVERY_POINT)
    assert len(every) == int(PERSON.sum())
    assert_close(points.mean(0), every.mean(0), atol=0.01, rtol=0)
