from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physic_core.backends.people import boxes_from_masks
from physic_core.types import (
    SURFACE_NAMES,
    Hints,
    People,
    SurfaceLabels,
)
from physic_embedded.networks.depth_anything import network_input_size
from physic_embedded.relative_pointmap import EmbeddedPointmap
from physic_embedded.single_view.disparity_floor import fit_disparity_floor
from physic_embedded.single_view.disparity_offset import disparity_at_infinity
from physic_embedded.single_view.flying_pixels import flying_pixels
from physic_embedded.single_view.vertical_costs import local_disparity_planes


def test_a_grazing_floor_has_no_flying_pixels_and_a_depth_edge_has():
    rows, columns = np.mgrid[0:120, 0:160]
    floor = 0.02 + np.maximum(rows - 30.0, 0) * 0.01
    floor[:30] = 0.02  # beyond the horizon line a wall so far that it stays behind
    assert not flying_pixels(floor[34:]).any()
    step = cv2.GaussianBlur(np.where(columns > 80, 1.0, 0.4).astype(np.float32), (0, 0), 1.0)
    flying = flying_pixels(step)
    assert flying[60, 79:83].all()
    assert not flying[:, :74].any()
    assert not flying[:, 88:].any()


HEIGHT = 180
WIDTH = 240
FOCAL = 200.0


def rays():
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    x = (columns - (WIDTH - 1) / 2) / FOCAL
    y = (rows - (HEIGHT - 1) / 2) / FOCAL
    return np.stack([x, y, np.ones_like(x)], -1)


def inverse_depth_of_a_room(turn, ahead=5.0):
    """1 / z of planes (P, H, W): of a room 1.5 m over its floor, walls at 2 m left, 3 m right and
    ``ahead``, 1.2 m under its ceiling.
    """
    down = turn[:, 1]
    right = turn[:, 0]
    planes = (down / 1.5, -right / 2.0, right / 3.0, turn[:, 2] / ahead, -down / 1.2)
    return np.stack([rays() @ plane for plane in planes])


def disparity_of(inverse):
    """Disparity (H, W) with a range of 1, its farthest pixels at 1, and their gap to infinity."""
    far = np.percentile(inverse, 0.5)
    span = np.ptp(np.percentile(inverse, [1, 99]))
    return (inverse - far) / span + 1.0, far / span


def turned(axes, *degrees):
    """Directions of a room, in columns: right, down, ahead."""
    return Rotation.from_euler(axes, degrees, degrees=True).as_matrix()


def angle_deg(one, other):
    return float(np.degrees(np.arccos(one @ other)))


def tilt_deg(floor, found, down):
    """Angle between the normal of the floor, with a disparity of infinity, and down."""
    return angle_deg(floor.normal(found.disparity, FOCAL / WIDTH), down)


def test_the_floor_comes_back_under_furniture_noise_and_a_hole():
    rng = np.random.default_rng(0)
    down = turned("xz", 10, 3)[:, 1]
    truth = 7 * np.maximum(rays() @ down / 1.5, 0.02) + 2.0
    disparity = truth + rng.normal(0, 0.01, truth.shape)
    disparity[100:160, 20:70] += 1.0  # a box on the floor
    hole = np.zeros(truth.shape, bool)
    hole[120:, 150:190] = True
    disparity[hole] += 0.8
    floor = fit_disparity_floor(disparity, hole)
    assert angle_deg(floor.normal(2.0, FOCAL / WIDTH), down) < 0.7
    assert floor.inlier_share > 0.5


def gap_of(found, disparity):
    """From infinity to the farthest pixels, in ranges of the map."""
    far, low, high = np.percentile(disparity, [0.5, 1, 99])
    return (far - found.disparity) / (high - low)


@pytest.mark.parametrize("ahead", [4.0, 6.0, 12.0])
def test_the_disparity_of_infinity_of_a_room_comes_back_from_its_gravity(ahead):
    turn = turned("yx", 8, 6)
    disparity, gap = disparity_of(inverse_depth_of_a_room(turn, ahead).max(0))
    floor = fit_disparity_floor(disparity)
    pitch = float(np.degrees(np.arctan2(turn[2, 1], turn[1, 1])))
    found = disparity_at_infinity(disparity, floor, FOCAL, pitch=(pitch, 1.5))
    assert gap_of(found, disparity) == pytest.approx(gap, rel=0.12)


@pytest.mark.parametrize(("pitch", "roll"), [(10, 0), (30, -20), (45, 10)])
def test_walls_upright_on_the_floor_settle_the_disparity_of_infinity(pitch, roll):
    turn = turned("yxz", 25, pitch, roll)
    planes = inverse_depth_of_a_room(turn, 4.0)[:4]
    ground = np.argmax(planes, axis=0) == 0
    disparity, gap = disparity_of(planes.max(0))
    floor = fit_disparity_floor(disparity, labelled=ground)
    walls = local_disparity_planes(disparity, ~ground, FOCAL)
    found = disparity_at_infinity(disparity, floor, FOCAL, walls=walls)
    assert tilt_deg(floor, found, turn[:, 1]) < 2
    assert found.disparity == pytest.approx(1 - gap, abs=0.1)


@pytest.mark.parametrize("ahead", [2.5, 4.0, 8.0])
def test_the_directions_of_a_room_tell_infinity_where_no_floor_is_seen(ahead):
    turn = turned("yxz", 35, -4, 2)
    corner = (rays() @ turn[:, 2] / ahead, rays() @ -turn[:, 0] / 2.5)
    disparity, gap = disparity_of(np.max(corner, axis=0))
    surfaces = local_disparity_planes(disparity, np.ones(disparity.shape, bool), FOCAL)
    for axes in (turn.T, -turn.T[[2, 0, 1]]):
        found = disparity_at_infinity(disparity, None, FOCAL, frame=(axes, 0.9), surfaces=surfaces)
        assert abs(np.log(gap_of(found, disparity) / gap)) < 2 * found.sigma
        assert found.sigma < 0.4
    unsure = disparity_at_infinity(disparity, None, FOCAL, frame=(turn.T, 0.1), surfaces=surfaces)
    assert unsure.sigma > found.sigma


def test_sky_over_ground_is_infinitely_far():
    down = turned("x", 5)[:, 1]
    disparity = 8 * np.maximum(rays() @ down / 1.5, 0.0)
    found = disparity_at_infinity(disparity, fit_disparity_floor(disparity), FOCAL)
    assert gap_of(found, disparity) < 0.01


def test_the_seen_horizon_is_that_of_ground_which_the_map_makes_steep_nearby():
    down = turned("xz", 6, 2)[:, 1]
    true = 8 * np.maximum(rays() @ down / 1.5, 0.0)
    disparity = true + 1.5 * np.maximum(true - 0.35 * true.max(), 0.0)
    floor = fit_disparity_floor(disparity)
    columns = np.arange(WIDTH)
    line = [-(down[0] * x + down[2]) / down[1] for x in (columns - (WIDTH - 1) / 2) / FOCAL]
    horizon = np.stack([columns, np.array(line) * FOCAL + (HEIGHT - 1) / 2], 1)

    def off(seen):
        found = disparity_at_infinity(disparity, floor, FOCAL, open_air=1.0, horizon=seen)
        return tilt_deg(floor, found, down)

    assert off(None) > 2 * off(horizon) > 0
    assert off(horizon) < 2.5
    hills = horizon + np.stack([0 * columns, 20 * np.sin(columns / 9)], 1)
    assert off(hills) > 0.8 * off(None)


def test_the_farthest_pixels_recede_smoothly_as_the_map_reaches_zero():
    rows = np.linspace(0, 1, HEIGHT)[:, None] * np.ones(WIDTH)
    maps = [8 * (rows + far) for far in np.linspace(0, 0.04, 41)]
    gaps = np.array([gap_of(disparity_at_infinity(one, None, FOCAL), one) for one in maps])
    steps = np.diff(np.log(gaps))
    assert gaps[0] < 0.05
    assert gaps[-1] > 0.3
    assert (steps > 0).all()
    assert steps.max() < 0.35


@pytest.fixture(scope="module")
def backend():
    made = EmbeddedPointmap(EmbeddedPointmap.Options(short_side=154, threads=1))
    made.load()
    return made


@pytest.fixture(scope="module")
def image(image):
    return cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def scene(backend, image):
    return backend.infer(image, Hints(hole=np.zeros((240, 320), bool)))


def hidden_by(*parts):
    """People (N) who hide parts of the photo."""
    masks = np.zeros((len(parts), 240, 320), bool)
    for mask, part in zip(masks, parts, strict=True):
        mask[part] = True
    return People(masks, boxes_from_masks(masks), np.ones(len(parts)))


def test_points_lie_on_their_pixels_rays_at_a_median_depth_of_one(scene):
    camera = scene.intrinsics
    assert "vanishing points" in camera.source
    assert camera.guessed
    assert 0.1 < camera.focal_sigma < 0.26
    assert abs(np.log(camera.fx / (0.85 * 320))) < camera.focal_sigma
    assert scene.unknown == "inverse_scale_shift"
    assert scene.valid.mean() > 0.8
    points = scene.points[scene.valid]
    assert np.isfinite(scene.points).all()
    assert points[:, 2].min() > 0
    assert np.median(points[:, 2]) == pytest.approx(1, rel=0.1)
    rows, columns = np.nonzero(scene.valid)
    assert camera.fx * points[:, 0] / points[:, 2] + camera.cx == pytest.approx(columns, abs=1e-2)
    assert camera.fy * points[:, 1] / points[:, 2] + camera.cy == pytest.approx(rows, abs=1e-2)
    assert f"{camera.focal_sigma:.0%}" in scene.notes[0]
    assert float(re.search(r"([\d.]+) times", scene.notes[1])[1]) > 1


def test_up_is_told_by_edges_of_a_room_else_by_the_look_of_the_picture(backend, image, scene):
    assert scene.up_source == "edges in three directions"
    blurred = cv2.GaussianBlur(image, (0, 0), 4)
    found = backend.infer(blurred, Hints(hole=np.zeros((240, 320), bool)))
    assert found.up_source == "look of the picture"
    assert np.degrees(np.arccos(found.up @ scene.up)) < 2 * found.up_sigma


def test_the_horizon_is_where_labels_of_sky_and_water_meet(backend, image):
    labels = np.full((240, 320), SURFACE_NAMES.index("water"), np.uint8)
    labels[:100] = SURFACE_NAMES.index("sky")
    apart = labels.copy()
    apart[80:100] = SURFACE_NAMES.index("vegetation")

    def points(surfaces):
        people = replace(hidden_by(), surfaces=SurfaceLabels(surfaces))
        return backend.infer(image, Hints(people=people)).points

    def upside_down_moves(surfaces):
        return np.abs(points(surfaces) / points(surfaces[::-1]) - 1).max()

    assert upside_down_moves(labels) > 0.05
    assert upside_down_moves(apart) < 1e-6


def test_the_map_of_the_photo_agrees_with_the_scene_outside_people(backend, image, scene):
    people = hidden_by(np.s_[40:239, 5:90])
    moved = replace(scene, points=scene.points * 3)  # the agreement must find this scale
    hints = Hints(intrinsics=scene.intrinsics, people=people, scene=moved)
    original = backend.infer(image, hints)
    both = original.valid & moved.valid & ~people.masks[0]
    apart = np.abs(np.log(original.points[..., 2] / moved.points[..., 2]))[both]
    assert np.median(apart) < 0.01
    assert original.intrinsics == scene.intrinsics
    assert original.notes == ()


def test_lines_are_those_of_the_photo_and_not_of_invented_pixels(backend, image):
    hole = np.zeros((240, 320), bool)
    hole[60:200, 40:200] = True
    rows, columns = np.mgrid[0:240, 0:320]
    cameras = []
    alone = []
    for pixels in (rows + columns // 3, rows - columns // 2):
        stripes = np.where(pixels % 40 < 20, 255, 0).astype(np.uint8)
        inpainted = np.where(hole[..., None], stripes[..., None], image)
        cameras.append(backend.infer(inpainted, Hints(hole=hole, photo=image)).intrinsics)
        alone.append(backend.infer(inpainted, Hints()).intrinsics)
    assert cameras[0] == cameras[1]
    assert alone[0] != alone[1]


def test_a_scene_hidden_by_people_is_said_not_to_be_matched(backend, image, scene):
    hints = Hints(intrinsics=scene.intrinsics, people=hidden_by(np.s_[:]), scene=scene)
    answer = backend.infer(image, hints)
    assert "could not be matched" in answer.notes[0]


@pytest.mark.parametrize("short_side", [518, 406])
@pytest.mark.parametrize(
    ("height", "width"), [(853, 1280), (960, 1280), (720, 1280), (1024, 1280), (914, 1280)]
)
def test_a_photo_with_a_column_or_row_less_has_the_same_network_input(height, width, short_side):
    less = [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert len({network_input_size(height - r, width - c, short_side) for r, c in less}) == 1
