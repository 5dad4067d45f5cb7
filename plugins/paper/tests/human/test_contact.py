"""DECO: its crops, and contact on the vertices of SMPL."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.types import People
from physic_human.deco import Deco, DecoOptions, contact_crop, enlarged_box_slices
from physic_human.smpl_backends import open_smpl
from physic_networks.bodies import empty_bodies

from .conftest import reading
from .seen import normalised_back


def test_the_network_gets_bgr_with_white_beside_the_person():
    image = np.full((200, 50, 3), [200, 100, 10], np.uint8)
    image[:80, :25] = 0  # at the top left
    box = np.array([0.0, 0, 50, 200])
    square = normalised_back(contact_crop(image, box))
    for columns in (slice(0, 95), slice(161, 256)):
        np.testing.assert_allclose(square[:, columns], 255, atol=0.1)
    crop = square[:, 97:159]
    np.testing.assert_allclose(crop[:95, :26], 0, atol=0.1)
    for part in (crop[:95, 36:], crop[110:]):
        np.testing.assert_allclose(part - [10, 100, 200], 0, atol=0.1)


DECO = """
import torch
from utils.hrnet import WIDTH

class DECO(torch.nn.Module):
    def __init__(self, encoder, context, device):
        super().__init__()
        assert (encoder, context, str(device)) == ("hrnet", True, "cpu") and WIDTH == 32
        self.gain = torch.nn.Parameter(torch.zeros(1))
        self.seen = []

    def forward(self, img):
        self.seen.append(img.numpy().copy())
        contact = torch.zeros(len(img), 6890)
        contact[:, 0] = 0.75 * self.gain
        return contact, torch.zeros(len(img), 133, 64, 64), torch.zeros(len(img), 26, 64, 64)
"""


def run_network(backend, count=1):
    """Contact of so many people in one place."""
    boxes = np.tile([100.0, 40, 180, 140], (count, 1))
    people = People(np.zeros((count, 200, 300), bool), boxes, np.ones(count))
    return backend.infer(np.zeros((200, 300, 3), np.uint8), people, empty_bodies("embedded"))


@pytest.fixture
def deco(stub, tmp_path, smpl_file):
    def make(**options):
        checkout = stub("deco", {"models/deco.py": DECO, "utils/hrnet.py": "WIDTH = 32"})
        path = tmp_path / "deco_best.pth"
        torch.save({"deco": {"gain": torch.ones(1)}, "epoch": 3}, path)
        places = {"checkout": str(checkout), "smpl_file": str(smpl_file)}
        backend = reading(Deco(DecoOptions(**places, **options)), path)
        backend.load()
        return backend

    return make


def test_deco_gives_smpls_labels_with_smpls_t_pose(deco, smpl_file):
    contact = run_network(deco(), 3)
    assert contact.topology == "smpl"
    assert contact.probability.shape == (3, 6890)
    np.testing.assert_allclose(contact.probability[:, 0], 0.75)
    wanted = open_smpl(str(smpl_file)).rest
    np.testing.assert_array_equal(contact.rest.vertices, wanted.vertices)


def test_the_box_grows_by_a_tenth_on_every_side_and_ends_at_the_image():
    assert enlarged_box_slices(np.array([100.0, 50, 200, 250]), 480, 640) == (
        slice(30, 270),
        slice(90, 210),
    )
    assert enlarged_box_slices(np.array([0.0, 400, 640, 480]), 480, 640) == (
        slice(392, 480),
        slice(0, 640),
    )
