"""EoMT: the real class with random weights, exported, and a network that knows what it is shown."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.adapters.panoptic import COCO_PANOPTIC
from physic_onnx.eomt import Eomt
from physic_testing import build_world, check_backend

PERSON, GROUND, WALL, NONE = 0, COCO_PANOPTIC.index("floor-other-merged"), COCO_PANOPTIC.index("wall-other-merged"), 133
PORTS = (
    {"pixel_values": ("float32", (1, 3, 640, 640))},
    {"class_queries_logits": ("float32", (1, 100, 134)), "masks_queries_logits": ("float32", (1, 100, 160, 160))},
)


def answer(shown, feed):
    """What a perfect network says of the padded square: a query a person, one for the ground, one for the rest."""
    classes, masks = np.full((1, 100, 134), -4.0), np.full((1, 100, 160, 160), -9.0)
    classes[..., NONE] = 6
    if shown.world is not None:
        people = shown.world.masks if shown.people else shown.world.masks[:0]
        floor = shown.world.floor_mask if shown.people else shown.world.empty_floor_mask
        rest = ~(people.any(axis=0) | floor)
        for q, (label, mask) in enumerate([*[(PERSON, m) for m in people], (GROUND, floor), (WALL, rest)]):
            classes[0, 3 * q, NONE], classes[0, 3 * q, label] = -4, 9 - 0.2 * q
            masks[0, 3 * q] = in_square(mask)
    return {"class_queries_logits": classes, "masks_queries_logits": masks}


def in_square(mask):
    """A mask of the photo, scaled to fit 640 px and put at the top left, as logits of 160 x 160 cells."""
    height, width = mask.shape
    scale = 640 / max(mask.shape)
    size = (max(1, round(height * scale)), max(1, round(width * scale)))
    share = torch.nn.functional.interpolate(torch.tensor(mask, dtype=torch.float32)[None, None], size, mode="bilinear")
    square = torch.zeros(1, 1, 640, 640)
    square[..., : size[0], : size[1]] = share
    return 18 * torch.nn.functional.interpolate(square, (160, 160), mode="area")[0, 0].numpy() - 9


@pytest.fixture(scope="module")
def eomt(told, told_network):
    def attach(backend):
        network = told_network(*PORTS, answer)
        backend.bind(network)
        backend.network = network
        return (network,)

    return told(Eomt, attach)


def test_conformance(eomt):
    check_backend(eomt).raise_if_failed()


@pytest.mark.parametrize("size", [(320, 240), (240, 320)])
def test_people_and_floor_of_a_world(eomt, size):
    """The padding is undone for photos that are wide and for photos that are high."""
    world = build_world("stand", 0, size)
    backend = eomt()
    backend.load()
    people = backend.infer(world.image)
    (mask,) = people.masks
    assert (mask & world.masks[0]).sum() / (mask | world.masks[0]).sum() > 0.9
    assert people.floor is not None
    assert (people.floor & world.floor_mask).sum() / (people.floor | world.floor_mask).sum() > 0.9


def test_the_network_sees_red_first_normalised_beside_black(eomt):
    """Black is put round the photo before it is normalised: it is not the network's nought."""
    photo = np.zeros((100, 200, 3), np.uint8)
    photo[..., 0] = 255
    backend = eomt()
    backend.load()
    backend.infer(photo)
    frame = backend.network.fed["pixel_values"][0]
    assert frame[:, 5, 600] == pytest.approx([(1 - 0.485) / 0.229, -0.456 / 0.224, -0.406 / 0.225], abs=1e-4)
    assert frame[:, 600, 5] == pytest.approx([-0.485 / 0.229, -0.456 / 0.224, -0.406 / 0.225], abs=1e-4)
