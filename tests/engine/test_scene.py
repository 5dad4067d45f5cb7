"""Stage 1: a relative point map and metric depth become a metric scene with camera, normals and
floor.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.ground.floor import describe_floor, index_of_best
from physic_core.engine.ground.floor_and_scale import scene_floor_candidates
from physic_core.engine.photo_content import PixelPoints
from physic_core.engine.scene.method import Cameras, SceneStageMethod
from physic_core.engine.scene.solve import build_scene
from physic_core.engine.up import angle_deg
from physic_core.geometry.camera import intrinsics_matrix, pixel_grid, pixel_rays, project

from .drawn import normal, uniform
from .seen import evidence_of

pytestmark = pytest.mark.quick

ROWS = 120
COLUMNS = 160
HEIGHT_M = 1.5
PAPER = engine_preset("paper").scene


def camera(focal=140.0, rows=ROWS, columns=COLUMNS):
    middle = (columns - 1) / 2, (rows - 1) / 2
    return intrinsics_matrix(focal, focal, *middle, torch.zeros((), dtype=torch.float64))


K = camera()
RAYS = pixel_rays(ROWS, COLUMNS, K)
UP = normalize(torch.tensor([0.0, -1.0, -0.2], dtype=torch.float64), dim=0)
FLOOR = HEIGHT_M / (-(RAYS @ UP)).clamp(min=1e-3)
BOX = torch.zeros((ROWS, COLUMNS), dtype=torch.bool)
BOX[40:70, 100:140] = True
DEPTH = torch.where(BOX, 2.5, FLOOR.clamp(max=6.0))
ON_FLOOR = (FLOOR <= DEPTH) & ~BOX
ALL = torch.ones((ROWS, COLUMNS), dtype=torch.bool)
FEET = torch.tensor([[60.0, 100.0], [75.0, 102.0]])


def relative(unknown):
    points = RAYS * DEPTH[..., None]
    if unknown == "scale":
        return points / 2
    if unknown == "scale_shift":
        return (points - torch.tensor([0.0, 0.0, 0.3])) / 2
    return RAYS * (2 / (1 / DEPTH - 0.05))[..., None]


@pytest.mark.parametrize("unknown", ["scale", "scale_shift", "inverse_scale_shift"])
@pytest.mark.parametrize("preset", ["default", "paper"])
def test_metric_scale_is_recovered_for_each_kind_of_unknown(unknown, preset):
    noisy = DEPTH * (1 + 0.02 * normal(ROWS, COLUMNS))
    state = scene(
        points=relative(unknown),
        unknown=unknown,
        depth=noisy,
        feet_px=FEET,
        settings=engine_preset(preset).scene,
    )
    error = ((state.points[..., 2] - DEPTH).abs() / DEPTH)[state.valid]
    assert float(error.median()) < 0.005
    assert angle_deg(state.floor.normal, UP) < 0.5
    assert state.floor.offset == pytest.approx(HEIGHT_M, abs=0.02)
    assert state.K[0, 0] == pytest.approx(140.0, rel=0.01)
    assert state.floor.height(state.floor_points).abs().max() < 1e-4


def scene(
    points=RAYS * DEPTH[..., None] / 2,
    unknown="scale",
    depth=DEPTH,
    settings=None,
    cameras=None,
    mask=ON_FLOOR,
    feet_px=FEET[:0],
):
    evidence = evidence_of(ALL.shape, mask=mask, feet_px=feet_px)
    relative = PixelPoints(points, ALL, unknown)
    candidates = scene_floor_candidates(relative, evidence)
    found = describe_floor(candidates, index_of_best(candidates), evidence)
    evidence = replace(evidence, known_search=found)
    cameras = cameras or Cameras(metric_depth=K)
    return build_scene(relative, depth, cameras, evidence, settings or SceneStageMethod())


def given(focal, **others):
    return Cameras(camera(focal), **others)


def test_every_valid_point_lies_on_its_pixels_ray_of_the_given_camera():
    state = scene(cameras=given(200.0, metric_depth=K))
    assert torch.equal(state.K, camera(200.0))
    assert_close(project(state.points, state.K), pixel_grid(ROWS, COLUMNS, state.points))


@pytest.mark.parametrize("focal", [100.0, 140.0, 200.0])
def test_a_scene_keeps_the_sizes_that_its_depth_network_saw(focal):
    """Pixels times Z / f: with a longer focal length the same things are farther away."""
    state = scene(cameras=given(focal, metric_depth=K))
    assert_close(state.points[..., 2], DEPTH * focal / 140.0)
    assert_close(state.points[..., :2], (RAYS * DEPTH[..., None])[..., :2])


def test_a_depth_of_unknown_camera_is_unchanged():
    state = scene(cameras=given(200.0))
    assert_close(state.points[..., 2], DEPTH)


@pytest.mark.parametrize("seen", [100.0, 196.0])
def test_of_two_estimated_cameras_the_mean_is_taken(seen):
    state = scene(cameras=Cameras(None, K, camera(seen)))
    mean = (140.0 * seen) ** 0.5
    assert state.K[0, 0] == state.K[1, 1] == pytest.approx(mean)
    assert state.K[:2, 2].tolist() == [(COLUMNS - 1) / 2, (ROWS - 1) / 2]
    assert_close(project(state.points, state.K), pixel_grid(ROWS, COLUMNS, state.points))
    assert float((state.points[..., 2] / DEPTH).median()) == pytest.approx(mean / 140.0, rel=0.01)


def test_a_point_map_of_another_camera_keeps_its_pixels_and_depth():
    own = camera(100.0)
    points = pixel_rays(ROWS, COLUMNS, own) * DEPTH[..., None]
    converted, _, _ = SceneStageMethod().share_camera(points, DEPTH, given(200.0, pointmap=own))
    assert_close(project(converted, camera(200.0)), pixel_grid(ROWS, COLUMNS, points))
    assert torch.equal(converted[..., 2], DEPTH)


def test_the_metric_depths_camera_comes_before_the_point_maps():
    wide = Cameras(metric_depth=camera(100.0))
    assert torch.equal(scene(cameras=wide).K, wide.metric_depth)
    assert scene(cameras=wide, settings=PAPER).K[0, 0] == pytest.approx(140.0)


def test_shift_is_found_by_depth_alone_without_a_known_camera():
    state = scene(relative("scale_shift"), "scale_shift", cameras=Cameras(), mask=None)
    assert state.diagnostics["alignment"]["shift"] == pytest.approx(0.3)
    assert_close(state.points[..., 2], DEPTH)


def test_pixels_beyond_the_maximum_depth_are_invalid():
    state = scene(settings=SceneStageMethod(far_m=5.0))
    assert not state.valid[DEPTH > 5].any()
    assert state.valid[DEPTH < 4.9].double().mean() > 0.98


def test_depth_edges_are_not_valid_but_keep_their_own_surfaces_normal():
    state = scene()
    assert not state.valid[50, 99:101].any()
    assert state.valid[50, [97, 102]].all()
    assert_close(state.normals[50, 100], torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64))


def test_a_photo_without_a_floor_reports_it_and_nothing_else_changes():
    state = scene(RAYS * 3.0, depth=torch.full_like(DEPTH, 3.0), mask=None)
    assert state.floor is None
    assert state.floor_points.shape == (0, 3)
    assert state.valid.all()
    assert state.diagnostics["floor"]["reason"] == "no_consensus"


def test_disagreement_with_the_metric_depth_is_reported():
    wrong = torch.where(uniform(ROWS, COLUMNS) < 0.7, DEPTH * 3, DEPTH)
    state = scene(depth=wrong * (1 + 0.2 * normal(ROWS, COLUMNS, seed=1).abs()))
    assert state.diagnostics["alignment"]["inlier_share"] < 0.5
