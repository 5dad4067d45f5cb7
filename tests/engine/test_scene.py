"""Stage 1: a relative point map and metric depth become a metric scene with camera, normals and
floor.
"""

from __future__ import annotations

import math

import pytest
import torch
from torch.nn.functional import normalize
from torch.testing import assert_close

from physic_core import engine_preset
from physic_core.engine.ground.floor import FloorEvidence
from physic_core.engine.photo import PixelPoints
from physic_core.engine.scene import solve
from physic_core.engine.scene.method import Cameras, SceneMethod
from physic_core.geometry import pointmap
from physic_core.geometry.camera import intrinsics_matrix, pixel_grid, pixel_rays, project
from physic_core.geometry.pointmap import edge_ratio

from .drawn import normal, uniform

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


def angle_deg(a, b):
    return math.degrees(math.acos(min(1.0, float(a.double() @ b.double()))))


@pytest.mark.parametrize("unknown", ["scale", "scale_shift", "inverse_scale_shift"])
@pytest.mark.parametrize("preset", ["default", "paper"])
def test_metric_scale_is_recovered_for_each_kind_of_unknown(unknown, preset):
    noisy = DEPTH * (1 + 0.02 * normal(ROWS, COLUMNS))
    state = build_scene(
        relative(unknown), ALL, unknown, noisy, K_metric=K, floor_mask=ON_FLOOR, feet_px=FEET,
        settings=engine_preset(preset).scene,
    )  # fmt: skip
    error = ((state.points[..., 2] - DEPTH).abs() / DEPTH)[state.valid]
    assert float(error.median()) < 0.005
    assert angle_deg(state.floor.normal, UP) < 0.5
    assert state.floor.offset == pytest.approx(HEIGHT_M, abs=0.02)
    assert state.K[0, 0] == pytest.approx(140.0, rel=0.01)
    assert state.floor.height(state.floor_points).abs().max() < 1e-4


def build_scene(
    points,
    valid,
    unknown,
    metric_depth,
    *,
    K=None,
    K_metric=None,
    K_pointmap=None,
    floor_mask=None,
    feet_px=None,
    settings=None,
):
    cameras = Cameras(K, K_metric, K_pointmap)
    floor = FloorEvidence(mask=floor_mask, feet_px=feet_px)
    relative = PixelPoints(points, valid, unknown)
    return solve.build_scene(relative, metric_depth, cameras, floor, settings or SceneMethod())


def scene(**options):
    given = {"K_metric": K, "floor_mask": ON_FLOOR}
    return build_scene(RAYS * DEPTH[..., None] / 2, ALL, "scale", DEPTH, **(given | options))


def test_every_valid_point_lies_on_its_pixels_ray_of_the_given_camera():
    mine = camera(200.0)
    state = scene(K=mine)
    assert torch.equal(state.K, mine)
    assert_close(project(state.points, mine), pixel_grid(ROWS, COLUMNS, state.points))


@pytest.mark.parametrize("focal", [100.0, 140.0, 200.0])
def test_a_scene_keeps_the_sizes_that_its_depth_network_saw(focal):
    """Pixels times Z / f: with a longer focal length the same things are farther away."""
    state = scene(K=camera(focal))
    assert_close(state.points[..., 2], DEPTH * focal / 140.0)
    assert_close(state.points[..., :2], (RAYS * DEPTH[..., None])[..., :2])


def test_a_depth_of_unknown_camera_is_unchanged():
    state = scene(K=camera(200.0), K_metric=None)
    assert_close(state.points[..., 2], DEPTH)


@pytest.mark.parametrize("seen", [100.0, 196.0])
def test_of_two_estimated_cameras_the_mean_is_taken(seen):
    state = scene(K_pointmap=camera(seen))
    mean = (140.0 * seen) ** 0.5
    assert state.K[0, 0] == state.K[1, 1] == pytest.approx(mean)
    assert state.K[:2, 2].tolist() == [(COLUMNS - 1) / 2, (ROWS - 1) / 2]
    assert_close(project(state.points, state.K), pixel_grid(ROWS, COLUMNS, state.points))
    assert float((state.points[..., 2] / DEPTH).median()) == pytest.approx(mean / 140.0, rel=0.01)


def test_a_point_map_of_another_camera_keeps_its_pixels_and_depth():
    own = camera(100.0)
    given = camera(200.0)
    points = pixel_rays(ROWS, COLUMNS, own) * DEPTH[..., None]
    converted, _, _ = SceneMethod().share_camera(points, DEPTH, Cameras(given=given, pointmap=own))
    assert_close(project(converted, given), pixel_grid(ROWS, COLUMNS, points))
    assert torch.equal(converted[..., 2], DEPTH)


def test_the_metric_depths_camera_comes_before_the_point_maps():
    wide = camera(100.0)
    assert torch.equal(scene(K_metric=wide).K, wide)
    assert scene(K_metric=wide, settings=PAPER).K[0, 0] == pytest.approx(140.0)


def test_shift_is_found_by_depth_alone_without_a_known_camera():
    state = build_scene(relative("scale_shift"), ALL, "scale_shift", DEPTH)
    assert state.diagnostics["alignment"]["shift"] == pytest.approx(0.3)
    assert_close(state.points[..., 2], DEPTH)


def test_pixels_beyond_the_maximum_depth_are_invalid():
    state = scene(settings=SceneMethod(far_m=5.0))
    assert not state.valid[DEPTH > 5].any()
    assert state.valid[DEPTH < 4.9].double().mean() > 0.98


def test_depth_edges_are_not_valid_but_keep_their_own_surfaces_normal():
    state = scene()
    assert not state.valid[50, 99:101].any()
    assert state.valid[50, [97, 102]].all()
    assert_close(state.normals[50, 100], torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64))


def test_the_grazing_far_floor_is_not_taken_for_an_edge(monkeypatch):
    without = build_scene(
        RAYS * DEPTH[..., None], ALL, "scale", DEPTH, K=K, settings=SceneMethod(floor="off")
    )
    monkeypatch.setattr(pointmap, "EDGE_RATIO", 1.01)
    with_floor = build_scene(RAYS * DEPTH[..., None], ALL, "scale", DEPTH, K=K)
    far_floor = ON_FLOOR & (DEPTH > 4) & (DEPTH < 5.5)
    far_floor[:, 95:145] = False
    assert bool(with_floor.valid[far_floor].all())
    normal = with_floor.floor.normal
    assert_close(
        with_floor.normals[far_floor], normal.expand(int(far_floor.sum()), 3), atol=0.01, rtol=0
    )
    assert without.floor is None


def test_a_photo_without_a_floor_reports_it_and_nothing_else_changes():
    wall = RAYS * 3.0
    state = build_scene(wall, ALL, "scale", wall[..., 2], K=K)
    assert state.floor is None
    assert state.floor_points.shape == (0, 3)
    assert state.valid.all()
    assert state.diagnostics["floor"]["reason"] == "no_consensus"


def test_a_floor_mask_that_is_no_floor_is_reported():
    state = scene(floor_mask=BOX)
    assert angle_deg(state.floor.normal, UP) < 0.5
    assert state.diagnostics["floor"]["in_mask"] is False


def test_disagreement_with_the_metric_depth_is_reported():
    wrong = torch.where(
        uniform(ROWS, COLUMNS) < 0.7,
        DEPTH * 3,
        DEPTH,
    )
    wrong = wrong * (1 + 0.2 * normal(ROWS, COLUMNS, seed=1).abs())
    state = build_scene(RAYS * DEPTH[..., None], ALL, "scale", wrong, K=K)
    assert state.diagnostics["alignment"]["inlier_share"] < 0.5


def test_floor_points_are_densest_where_the_feet_are():
    state = scene(feet_px=FEET)
    foot = RAYS[100, 60] * FLOOR[100, 60]
    near = (state.floor_points - foot).norm(dim=-1) < 0.2
    assert int(near.sum()) == pytest.approx(math.pi * 0.2**2 / 0.025**2, rel=0.1)
    assert len(state.floor_points) <= 40_000
    assert len(scene(settings=PAPER).floor_points) == 10_000


def test_the_same_slope_is_an_edge_at_every_resolution():
    assert edge_ratio(768, 1024) == pytest.approx(1.05)
    assert edge_ratio(1536, 2048) == pytest.approx(1.05**0.5)
    assert edge_ratio(100, 100) == pytest.approx(1.05**2)
