"""The paper's floor search in metres, on the points of a floor mask."""

from __future__ import annotations

import math

import pytest
import torch

from physic_core.geometry.camera import intrinsics_matrix, pixel_rays
from physic_core.geometry.pointmap import pointmap_normals
from physic_paper import floor_metric
from physic_paper.floor_metric import fit_floor_metric

ROWS = 180
COLUMNS = 240
RAYS = pixel_rays(
    ROWS,
    COLUMNS,
    intrinsics_matrix(200.0, 200.0, 119.5, 89.5, torch.zeros((), dtype=torch.float64)),
)
ALL = torch.ones((ROWS, COLUMNS), dtype=torch.bool)


def test_the_floor_of_its_mask_is_found_to_the_centimetre():
    up = torch.tensor(
        [0.0, -math.cos(math.radians(15)), -math.sin(math.radians(15))], dtype=torch.float64
    )
    floor = 1.5 / (-(RAYS @ up)).clamp(min=1e-3)
    depth = floor.clamp(max=6.0)
    depth[60:120, 10:50] = depth[60:120, 10:50].clamp(max=3.5)
    on_floor = floor <= depth
    on_floor[60:120, 10:50] = True  # the mask covers a piece of furniture too
    noise = torch.randn(
        ROWS, COLUMNS, dtype=torch.float64, generator=torch.Generator().manual_seed(0)
    )
    points = RAYS * (depth * (1 + 0.0005 * noise))[..., None]
    fitted = fit_floor_metric(points, pointmap_normals(RAYS * depth[..., None], ALL), ALL, on_floor)
    assert math.degrees(math.acos(min(1.0, float(fitted.plane.normal.double() @ up)))) < 0.1
    assert fitted.plane.offset == pytest.approx(1.5, abs=0.005)
    assert fitted.inlier_share > 0.7


def test_without_a_floor_mask_no_floor_is_found():
    points = RAYS * 2
    assert fit_floor_metric(points, pointmap_normals(points, ALL), ALL, None).reason == "no_pixels"
    assert fit_floor_metric(points, pointmap_normals(points, ALL), ALL, ~ALL).reason == "no_pixels"


def test_points_without_a_plane_are_refused(monkeypatch):
    points = RAYS * (
        1 + 5 * torch.rand(ROWS, COLUMNS, 1, generator=torch.Generator().manual_seed(0))
    )
    monkeypatch.setattr(floor_metric, "MIN_INLIER_SHARE", 0.3)
    floor = fit_floor_metric(points, pointmap_normals(points, ALL, math.inf), ALL, ALL)
    assert (floor.plane, floor.reason) == (None, "no_consensus")
