"""Left and right of pairs of limbs that a detector mixed up."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from physic_core.body import load_body
from physic_core.engine.placement.left_right import LIMB_PAIRS, fix_left_right_swaps
from physic_core.types import SKELETONS, Skeleton

COCO = SKELETONS["coco23"]
NAMES = COCO.names
OWN = Skeleton("own", tuple(f"own_{name}" for name in NAMES))


def standing() -> torch.Tensor:
    """(1, J, 2) px of a person of 170 px in A-pose, seen from the front."""
    model = load_body("embedded")
    body = model(torch.eye(3).expand(1, 55, 3, 3), torch.zeros(1, model.num_betas), torch.zeros(1, 3))
    return model.landmarks(body, "coco23")[..., :2] * 100


def exchanged(points: torch.Tensor, pairs: tuple[str, ...]) -> torch.Tensor:
    order = list(range(len(NAMES)))
    for j, name in enumerate(NAMES):
        side, _, point = name.partition("_")
        if any(point in LIMB_PAIRS[pair] for pair in pairs):
            order[j] = NAMES.index(f"{'right' if side == 'left' else 'left'}_{point}")
    return points[:, order]


@given(pair=st.sampled_from(sorted(LIMB_PAIRS)), noise=st.floats(0, 4), seed=st.integers(0, 2**16))
def test_a_mixed_up_pair_gets_its_points_back(pair: str, noise: float, seed: int):
    truth = standing()
    shaken = truth + noise * torch.randn(truth.shape, generator=torch.Generator().manual_seed(seed)).clamp(-2, 2)
    found = exchanged(shaken, (pair,))
    sides = fix_left_right_swaps(COCO, found, torch.ones(1, len(NAMES)), truth, 125.0)
    assert sides.exchanged == ((pair,),)
    assert torch.equal(found.take_along_dim(sides.order[..., None], 1), shaken)


@given(pair=st.sampled_from(sorted(LIMB_PAIRS)), x=st.floats(-40, 40), y=st.floats(-40, 40))
def test_a_body_that_was_drawn_aside_tells_the_sides_as_well(pair: str, x: float, y: float):
    truth = standing()
    aside = truth + torch.tensor([x, y])
    sure = torch.ones(1, len(NAMES))
    assert fix_left_right_swaps(COCO, exchanged(truth, (pair,)), sure, aside, 125.0).exchanged == ((pair,),)
    assert fix_left_right_swaps(COCO, truth, sure, aside, 125.0).exchanged == ((),)


@given(noise=st.floats(0, 8), seed=st.integers(0, 2**16))
def test_points_on_their_own_side_stay(noise: float, seed: int):
    truth = standing()
    found = truth + noise * torch.randn(truth.shape, generator=torch.Generator().manual_seed(seed)).clamp(-2, 2)
    sides = fix_left_right_swaps(COCO, found, torch.ones(1, len(NAMES)), truth, 125.0)
    assert sides.exchanged == ((),)
    assert torch.equal(sides.order, torch.arange(len(NAMES))[None])


def test_a_body_that_is_turned_the_other_way_keeps_its_keypoints():
    truth = standing()
    found = exchanged(truth, ("arms", "legs"))
    assert fix_left_right_swaps(COCO, found, torch.ones(1, len(NAMES)), truth, 125.0).exchanged == ((),)


@pytest.mark.parametrize(
    ("skeleton", "most_deg", "confidence", "scale"),
    [
        (COCO, 180.0, 1.0, 1.0),
        (COCO, 125.0, 0.0, 1.0),
        (OWN, 125.0, 1.0, 1.0),
        (COCO, 125.0, 1.0, 0.0),
    ],
    ids=["switched off", "nothing seen", "names of its own", "body without extent"],
)
def test_nothing_is_exchanged_without_a_reason(skeleton: Skeleton, most_deg: float, confidence: float, scale: float):
    truth = standing() * scale
    found = exchanged(truth, ("arms",))
    sides = fix_left_right_swaps(skeleton, found, torch.full((1, len(NAMES)), confidence), truth, most_deg)
    assert sides.exchanged == ((),)


def test_people_without_numbers_disturb_nobody():
    truth = standing()
    found = torch.cat([torch.full_like(truth, torch.nan), exchanged(truth, ("legs",)), truth])
    expected = torch.cat([truth, truth, torch.full_like(truth, torch.nan)])
    assert fix_left_right_swaps(COCO, found, torch.ones(3, len(NAMES)), expected, 125.0).exchanged == (
        (),
        ("legs",),
        (),
    )
