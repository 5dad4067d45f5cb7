"""Distances of body parts to inpainted surfaces, at known depths."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from physic_core.engine.contact.inpainted_surfaces import lower_to_parts

UP = torch.tensor([0.0, -1.0, 0.0])
DEPTHS = torch.linspace(-0.05, 0.05, 101)
"""Of a part that is 5 cm inside the surface: a tenth of it is deeper than 4 cm."""


def lower(before: Tensor, *, give: float = 0.0, normals: Tensor = UP, inpainted: bool = True) -> Tensor:
    """Return the distances (V,) of one part whose distances to the moved surface are 1 mm."""
    count = len(before)
    return lower_to_parts(
        torch.full((1, count), 0.001),
        before[None],
        normals.expand(1, count, 3),
        torch.full((1, count), give),
        torch.full((1, count), inpainted),
        torch.zeros(count, dtype=torch.int64),
    )[0]


def test_the_surface_is_lowered_until_a_tenth_of_the_part_is_inside():
    torch.testing.assert_close(lower(DEPTHS), DEPTHS + 0.04)


def test_a_surface_that_gives_way_is_lowered_by_what_is_deeper():
    torch.testing.assert_close(lower(DEPTHS, give=0.03), DEPTHS + 0.01)
    torch.testing.assert_close(lower(DEPTHS, give=0.08), torch.full_like(DEPTHS, 0.001))


def test_a_part_outside_of_the_surface_keeps_its_distances():
    torch.testing.assert_close(lower(DEPTHS + 0.06), torch.full_like(DEPTHS, 0.001))


def test_a_bar_is_not_lowered():
    angles = torch.linspace(0, 2 * math.pi, len(DEPTHS))
    around = torch.stack([angles.cos(), angles.sin(), 0 * angles], dim=-1)
    torch.testing.assert_close(lower(DEPTHS, normals=around), torch.full_like(DEPTHS, 0.001))


def test_a_few_vertices_and_visible_surfaces_keep_their_distances():
    torch.testing.assert_close(lower(DEPTHS[:9]), torch.full((9,), 0.001))
    torch.testing.assert_close(lower(DEPTHS, inpainted=False), torch.full_like(DEPTHS, 0.001))


def test_vertices_without_a_surface_before_keep_their_distances():
    before = torch.cat([DEPTHS, torch.tensor([math.inf])])
    found = lower(before)
    torch.testing.assert_close(found[:-1], DEPTHS + 0.04)
    assert found[-1] == torch.tensor(0.001)


def test_each_part_is_lowered_by_its_own_depth():
    before = torch.cat([DEPTHS, DEPTHS + 0.02])
    part = torch.arange(2).repeat_interleave(len(DEPTHS))
    ones = torch.ones(1, len(before))
    found = lower_to_parts(0 * ones, before[None], UP.expand(1, len(before), 3), 0 * ones, ones > 0, part)[0]
    torch.testing.assert_close(found, torch.cat([DEPTHS + 0.04, DEPTHS + 0.04]))
