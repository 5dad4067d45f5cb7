"""The floor search: found under noise, furniture and people-shaped holes; not found where there is
none.
"""

from __future__ import annotations

import math

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch.nn.functional import normalize

from physic_core.engine.ground.floor import (
    GroundAtSoles,
    describe_floor,
    floor_candidates,
    index_of_best,
)
from physic_core.engine.up import angle_deg
from physic_core.geometry import floor
from physic_core.geometry.camera import intrinsics_matrix, pixel_rays
from physic_core.geometry.pointmap import pointmap_normals

from .drawn import normal
from .seen import evidence_of

ROWS = 180
COLUMNS = 240
RAYS = pixel_rays(
    ROWS,
    COLUMNS,
    intrinsics_matrix(200.0, 200.0, 119.5, 89.5, torch.zeros((), dtype=torch.float64)),
)
ALL = torch.ones((ROWS, COLUMNS), dtype=torch.bool)


class Area:
    """``Area()[rows, columns]`` is the mask (H, W) of a part of the picture."""

    def __getitem__(self, part):
        mask = torch.zeros_like(ALL)
        mask[part] = True
        return mask


area = Area()


def fit_floor(depth, *, every=1, surfaces=False, **evidence):
    """Of every n-th pixel of a depth (H, W); with the normals of its surfaces, if surfaces."""
    points = (RAYS * depth[..., None])[::every, ::every]
    valid = ALL[::every, ::every]
    normals = pointmap_normals(points, valid) if surfaces else torch.zeros_like(points)
    evidence = evidence_of(valid.shape, **evidence)
    candidates = floor_candidates(points, valid, evidence, normals)
    return describe_floor(candidates, index_of_best(candidates), evidence)


NOISE = normal(ROWS, COLUMNS)


def up(pitch_deg, roll_deg=0.0):
    """Normal of a level floor, seen by a camera that looks down by ``pitch_deg`` and is rolled by
    ``roll_deg``.
    """
    turn = Rotation.from_euler("xz", [pitch_deg, roll_deg], degrees=True)
    return torch.from_numpy(turn.apply([0.0, -1.0, 0.0]))


def meet(normal, offset):
    """Depth (H, W) of a plane, inf where its rays never meet it."""
    steep = -(RAYS @ normal)
    return torch.where(steep > 1e-6, offset / steep.clamp(min=1e-6), math.inf)


def room(normal, camera_height=1.5, wall=6.0):
    """Depth (H, W) of floor, far wall and furniture standing on it, and where the floor is seen."""
    floor = meet(normal, camera_height)
    depth = floor.clamp(max=wall)
    for part, z in ((area[60:120, 10:50], 3.5), (area[80:140, 180:230], 2.5)):
        depth = torch.where(part, depth.clamp(max=z), depth)
    return depth, (floor <= wall) & (floor <= depth)


def assert_plane(plane, normal, offset, *, degrees=0.3, metres=0.02):
    assert angle_deg(plane.normal, normal) < degrees
    assert plane.offset == pytest.approx(offset, abs=metres)


def assert_moved(plain, moved, before, after):
    """The floor keeps its normal and goes from one offset to another."""
    assert (plain.plane.offset, plain.plane.reanchored) == (pytest.approx(before, abs=0.02), 1.0)
    assert moved.plane.offset == pytest.approx(after, abs=0.02)
    assert moved.plane.reanchored == pytest.approx(before / after, abs=0.01)
    assert torch.equal(plain.plane.normal, moved.plane.normal)


@pytest.mark.parametrize(("pitch", "roll"), [(5.0, 0.0), (15.0, -12.0), (35.0, -12.0)])
@pytest.mark.parametrize("masked", [False, True])
def test_the_floor_of_a_furnished_room_is_found_under_noise(pitch, roll, masked):
    normal = up(pitch, roll)
    depth, on_floor = room(normal)
    found = fit_floor((depth * (1 + 0.01 * NOISE)).float(), mask=on_floor if masked else None)
    assert found.reason == "found"
    plane = found.plane
    assert_plane(plane, normal, 1.5, degrees=0.5)
    assert float(plane.inliers[on_floor].double().mean()) > 0.6
    assert float(torch.linalg.vector_norm(plane.normal)) == pytest.approx(1.0)


def test_the_resolution_does_not_matter():
    normal = up(12)
    depth, _ = room(normal)
    found = fit_floor(depth, every=3)
    assert_plane(found.plane, normal, 1.5, degrees=0.1)
    assert found.inlier_share == pytest.approx(0.67, abs=0.05)


def test_inpainted_pixels_weigh_less_than_visible_ones():
    normal = up(12)
    hole = area[90:, :130]  # more than half of the lower picture is made up, and wrong
    depth = torch.where(hole, meet(normal, 1.9), meet(normal, 1.5)).clamp(max=20)
    assert fit_floor(depth).plane.offset == pytest.approx(1.9, abs=0.05)
    assert fit_floor(depth, hole=hole).plane.offset == pytest.approx(1.5, abs=0.05)


def test_feet_keep_the_horizon_and_set_the_height():
    normal = up(12)
    seen = meet(normal, 1.8).clamp(max=20)
    near_feet = (slice(120, 160), slice(90, 140))
    # the ground that the people stand on lies nearer
    seen[near_feet] = meet(normal, 1.5)[near_feet]
    feet = torch.tensor([[110.0, 140.0], [120.0, 142.0]])
    assert_moved(fit_floor(seen), fit_floor(seen, feet_px=feet), 1.8, 1.5)


def test_a_mask_on_a_table_is_not_followed():
    normal = up(25)
    on_table = area[95:140, 60:180]
    depth = torch.where(on_table, meet(normal, 0.7), meet(normal, 1.5).clamp(max=12))
    found = fit_floor(depth, mask=on_table)
    assert not found.in_mask
    assert_plane(found.plane, normal, 1.5)
    assert found.plane.source == "lower image"


def test_a_tilted_camera_beyond_the_roll_limit_finds_none():
    assert fit_floor(meet(up(15, 40), 1.5).clamp(max=8)).plane is None


def test_points_at_infinity_and_wrong_validity_change_nothing():
    normal = up(12)
    depth = meet(normal, 1.5)  # inf above the horizon
    depth[170:, :5] = math.nan
    plane = fit_floor(depth).plane
    assert_plane(plane, normal, 1.5, degrees=0.05)
    assert not plane.inliers[0].any()


def walled(normal, camera_height=1.5):
    """Depth (H, W) of a floor between two upright walls that stand square to each other, and where
    the floor is.
    """
    askew = math.radians(20.0)
    floor = meet(normal, camera_height)
    ahead = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    ahead = normalize(ahead - (ahead @ normal) * normal, dim=0)
    right = torch.linalg.cross(ahead, normal)
    back = meet(-(math.cos(askew) * ahead + math.sin(askew) * right), 6.0)
    side = meet(math.sin(askew) * ahead - math.cos(askew) * right, 3.0)
    depth = torch.minimum(floor, torch.minimum(back, side))
    return depth, floor <= depth


@pytest.mark.parametrize("pitch", [15.0, 25.0])
def test_surfaces_tell_a_small_floor_from_a_big_table_beside_it(pitch):
    normal = up(pitch)
    depth, on_floor = walled(normal)
    on_table = area[95:, 36:]
    depth = torch.where(on_table, torch.minimum(depth, meet(normal, 0.7)), depth)
    alone = fit_floor(depth)
    fit = fit_floor(depth, surfaces=True)
    assert (alone.plane, alone.reason) == (None, "no_consensus")
    assert fit.reason == "found"
    assert fit.plane.source == "level surfaces"
    assert_plane(fit.plane, normal, 1.5)
    assert not fit.plane.inliers[120:, 40:].any()
    assert float((on_floor & ~on_table)[72:].double().mean()) < 0.4


@pytest.mark.parametrize(
    ("pitch", "roll", "masked"), [(55, 0, True), (50, -15, True), (55, 5, False)]
)
def test_a_camera_that_looks_down_steeply_sees_the_floor(pitch, roll, masked):
    """The up direction is first looked for round the camera's own, and finds the walls' there."""
    depth, on_floor = walled(up(pitch, roll), 3.0)
    noisy = depth + 0.004 * depth * NOISE
    found = fit_floor(noisy, surfaces=True, mask=on_floor if masked else None)
    assert_plane(found.plane, up(pitch, roll), 3.0, degrees=2, metres=0.09)


@pytest.mark.parametrize("pitch", [80, 85])
def test_a_wall_that_fills_the_photo_is_no_floor_seen_from_above(pitch):
    wall = meet(up(pitch), 3.0) * (1 + 0.01 * NOISE)
    wall[:, :60] = wall[:, :60].clamp(max=2.0)
    lower = area[60:]
    assert fit_floor(wall, surfaces=True, mask=lower).plane is not None
    assert fit_floor(wall, surfaces=True, no_ground=lower).plane is None


def two_levels():
    """Depth (H, W) of sand on the right third of the picture, 1.5 m below the camera, and of a
    larger lower level; and the sand.
    """
    normal = up(12)
    sand = area[:, 160:]
    return torch.where(sand, meet(normal, 1.5), meet(normal, 1.9)).clamp(max=20), sand


def beside(column, stands=0.85, real=1.0):
    rows, columns = area[130:150, column : column + 20].nonzero(as_tuple=True)
    return GroundAtSoles(rows, columns, stands, real, 0)


def test_the_floor_is_the_surface_that_seen_soles_share_whatever_its_label():
    depth, sand = two_levels()
    feet = torch.tensor([[175.0, 140.0], [205.0, 140.0]])
    for seen, offset in (
        ({}, 1.9),
        ({"feet_px": feet, "ground_at_soles": (beside(165), beside(195))}, 1.5),
        ({"ground_at_soles": (beside(165, stands=0.05), beside(195, stands=0.05))}, 1.9),
    ):
        plane = fit_floor(depth, no_ground=sand, **seen).plane
        assert plane.offset == pytest.approx(offset, abs=0.05)


def test_the_floor_is_moved_to_the_ground_beside_soles():
    """The ground rises under the people: they stand on what is seen there."""
    normal = up(12)
    depth = meet(normal, 1.8).clamp(max=20)
    depth[125:155, 80:110] = meet(normal, 1.5)[125:155, 80:110]
    assert_moved(fit_floor(depth), fit_floor(depth, ground_at_soles=(beside(85),)), 1.8, 1.5)


def test_a_floor_is_found_again_with_another_offset_of_depth_and_none_if_it_is_upside_down():
    normal = up(20.0)
    depth, on_floor = room(normal)
    found = fit_floor(depth, mask=on_floor)
    farther = 1 / (1 / depth + 0.05)
    again = floor.refit_floor(RAYS * farther[..., None], ALL, found)
    assert angle_deg(again.plane.normal, normal) < 30
    turned = 1 / (2 / float(depth.min()) - 1 / depth)
    assert floor.refit_floor(RAYS * turned[..., None], ALL, found).plane is None
