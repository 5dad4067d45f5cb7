"""Silhouettes of bodies of known size against masks and depths."""

from __future__ import annotations

import pytest
import torch

from physic_core.engine.measures import compare_silhouettes

HEIGHT = 300
WIDTH = 400
K = torch.tensor([[200.0, 0.0, 199.5], [0.0, 200.0, 149.5], [0.0, 0.0, 1.0]])
FACES = torch.tensor([[0, 3, 2], [0, 2, 1], [0, 1, 2], [0, 2, 3]])


def plate(x=0.0, z=4.0):
    """(4, 3): a plate of 1 m by 2 m that faces the camera, 50 by 100 px at 4 m."""
    return torch.tensor(
        [[x - 0.5, -1.0, z], [x + 0.5, -1.0, z], [x + 0.5, 1.0, z], [x - 0.5, 1.0, z]]
    )


def mask(left=175, right=225, top=100, bottom=200):
    """(300, 400) bool, the pixels of the plate unless other edges are given."""
    pixels = torch.zeros((HEIGHT, WIDTH), dtype=torch.bool)
    pixels[top:bottom, left:right] = True
    return pixels


def depth(metres):
    return torch.full((HEIGHT, WIDTH), metres)


UNKNOWN = depth(torch.nan)


def compare(*masks, bodies=(), scene=UNKNOWN, photo=UNKNOWN):
    vertices = torch.stack(bodies or (plate(),) * len(masks))
    return compare_silhouettes(vertices, FACES, torch.stack(masks), K, scene, photo)


def test_a_body_that_fills_its_mask():
    assert compare(mask()) == [(1.0, None)]


def test_a_body_beyond_its_mask():
    (found,) = compare(mask(bottom=150))
    assert found[0] == pytest.approx((50 + 2) / 100, abs=0.015)


def test_pixels_that_another_person_hides_do_not_count():
    upper = mask(bottom=150)
    lower = mask(top=150)
    other = plate(x=1.5)
    assert compare(upper, lower, bodies=(plate(), other))[0][0] == 1


def test_pixels_that_a_nearer_object_hides_do_not_count():
    desk = depth(9.0)
    desk[150:] = 3.0
    assert compare(mask(bottom=150), scene=desk)[0][0] == 1
    desk[150:] = 4.5  # it is behind the body
    share = compare(mask(bottom=150), scene=desk)[0][0]
    assert share == pytest.approx(0.52, abs=0.015)
