"""Hands: boxes from keypoints, the user's MANO file, rotations of right-hand networks, and
WiLoR.
"""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from physic_core.errors import BackendError
from physic_core.types import Keypoints, People
from physic_human.hands import HandBoxes, chumpy_free_copy, hands_from_mano, visible_hand_boxes
from physic_human.wilor import Wilor, WilorOptions
from physic_testing.body_files import mano_arrays, write_published

from .conftest import reading
from .seen import coordinates, place_of


def blank(skeleton, count, people=1):
    return Keypoints(np.zeros((people, count, 2)), np.zeros((people, count)), skeleton)


def test_the_21_points_of_a_hand_give_its_box():
    _, detected = keypoints({"left": (50, 80, 90, 140)}, confidence=0.8)
    hands = visible_hand_boxes(detected)
    # half open: counted from edges of pixels
    np.testing.assert_allclose(hands.boxes, [[50.5, 80.5, 90.5, 140.5]])
    np.testing.assert_allclose(hands.confidence, [0.8])
    assert hands.is_right.tolist() == [False]
    assert not len(visible_hand_boxes(detected, least_confidence=0.9))


def test_a_hand_is_beyond_the_wrist_where_only_arms_are_known():
    for skeleton, count, arm in (("coco17", 17, (6, 8, 10)), ("blazepose33", 33, (12, 14, 16))):
        arms = blank(skeleton, count)
        arms.points[0, list(arm)] = [[0, 0], [100, 0], [200, 0]]
        arms.confidence[0, list(arm)] = [1.0, 0.7, 0.9]
        hands = visible_hand_boxes(arms)
        assert hands.is_right.tolist() == [True]
        np.testing.assert_allclose(hands.boxes[0], [196, -37, 271, 38])
        np.testing.assert_allclose(hands.confidence, [0.7])


@pytest.fixture
def mano(tmp_path):
    return write_published(tmp_path / "MANO_RIGHT.pkl", mano_arrays())


def test_the_published_file_has_a_copy_that_needs_no_chumpy(mano):
    with chumpy_free_copy(str(mano)) as copy:
        arrays = pickle.loads(copy.read_bytes(), encoding="latin1")  # as smplx reads it
        assert copy.name == "MANO_RIGHT.pkl", "smplx tells right hands by this name"
    for (name, array), (wanted, published) in zip(
        arrays.items(), mano_arrays().items(), strict=True
    ):
        assert (name, type(array), array.dtype) == (wanted, np.ndarray, published.dtype)
        np.testing.assert_array_equal(array, published)


def test_a_copy_exists_only_inside_the_block_and_for_its_user_alone(mano, tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSIC_CACHE", str(tmp_path / "kept"))
    with chumpy_free_copy(mano) as copy:
        assert os.name != "posix" or copy.parent.stat().st_mode & 0o077 == 0
    assert not copy.parent.exists()
    assert not (tmp_path / "kept").exists()


RNG = np.random.default_rng(0)
FINGERS = RNG.normal(0, 0.4, (2, 15, 3))
TURNED_WRISTS = RNG.normal(0, 1, (2, 1, 3))
BOTH = HandBoxes(np.ones(2, int), np.array([False, True]), np.zeros((2, 4)), np.array([0.8, 0.9]))


def test_a_hand_that_is_not_a_number_was_not_found():
    broken = FINGERS.copy()
    broken[1, 3] = np.nan
    hands = hands_from_mano(2, BOTH, broken, TURNED_WRISTS)
    np.testing.assert_allclose(hands.confidence[1], [0.8, 0.0], atol=1e-6)
    assert np.isfinite(hands.rotvecs).all()


# smplx.MANOLayer, as far as both projects hand it their file.
MANO = """
import os
import pickle
import numpy as np
import torch

class MANOLayer(torch.nn.Module):
    def __init__(self, model_path, **kwargs):
        super().__init__()
        if os.path.isdir(model_path):
            model_path = os.path.join(model_path, "MANO_RIGHT.pkl")
        assert "RIGHT" in os.path.basename(model_path), "a left hand"
        with open(model_path, "rb") as file:
            self.data = pickle.load(file, encoding="latin1")
        for name in ("shapedirs", "J_regressor", "hands_mean", "weights"):
            self.register_buffer(name, torch.tensor(np.array(self.data[name], dtype=np.float32)))
        assert self.J_regressor.shape == (16, 778) and self.shapedirs.shape == (778, 3, 10)
"""

WILOR = """
import os
import torch
from .mano import MANOLayer

class WiLor(torch.nn.Module):
    def __init__(self, **kwargs):
        super().__init__()
        assert os.path.exists(kwargs["mano_mean_path"])
        self.mano = MANOLayer(kwargs["mano_model_path"])
        assert kwargs["focal_length"] == 5000 and kwargs["image_size"] == 256
        self.gain = torch.nn.Parameter(torch.zeros(1))
        self.seen = []

    def forward(self, x):
        self.seen.append(x.numpy().copy())
        x = x.flip(dims=[-1]) / 255.0
        count = len(x)
        pose = torch.zeros(count, 15, 3)
        pose[:, 0] = self.gain * x[:, 128, 128]
        turned = torch.full((count, 1, 3), 0.2)
        return {"hand_pose": pose, "global_orient": turned, "betas": torch.zeros(count, 10),
                "pred_cam": torch.ones(count, 3)}
"""

WILOR_FILES = {"wilor_mini/__init__.py": "", "wilor_mini/models/mano.py": MANO}


def keypoints(boxes, confidence=0.9):
    """One person with the 21 points of one or both hands on the edges of boxes, whole-body
    skeleton.
    """
    detected = blank("coco_wholebody133", 133)
    for side, box in boxes.items():
        first = 91 if side == "left" else 112
        detected.points[0, first : first + 21] = np.linspace(box[:2], box[2:], 21)
        detected.confidence[0, first : first + 21] = confidence
    return People(
        np.zeros((1, 200, 300), bool), np.array([[0.0, 0, 300, 200]]), np.ones(1)
    ), detected


@pytest.fixture
def make_wilor(stub, tmp_path):
    """A backend on files of its own; ``code`` is that of its network, ``checkpoint`` what its
    checkpoint holds.
    """

    def make(code=WILOR, checkpoint=None, **options):
        checkout = stub("wilor", WILOR_FILES | {"wilor_mini/models/wilor.py": code})
        folder = tmp_path / "files"
        folder.mkdir(exist_ok=True)
        usual = {"state_dict": {"gain": torch.full((1,), 0.5), "mano.faces": torch.zeros(2)}}
        torch.save(checkpoint or usual, folder / "wilor_final.ckpt")
        write_published(folder / "MANO_RIGHT.pkl", mano_arrays())
        (folder / "mano_mean_params.npz").write_bytes(b"")
        return reading(Wilor(WilorOptions(checkout=str(checkout), **options)), folder)

    return make


@pytest.fixture
def wilor(make_wilor):
    backend = make_wilor()
    backend.load()
    return backend


def test_left_hands_are_mirrored_for_the_network_and_back(wilor):
    picture = coordinates(200, 300)
    hands = wilor.infer(
        picture, *keypoints({"left": [60, 80, 100, 110], "right": [180, 80, 220, 110]})
    )
    left, right = (place_of(crop[..., ::-1], 200, 300) for crop in wilor.network.seen[0])
    assert left.step[0] < 0 < right.step[0]
    for place, middle in ((left, [79.5, 94.5]), (right, [199.5, 94.5])):
        np.testing.assert_allclose(place.at(0.5), middle, atol=0.8)
        np.testing.assert_allclose(np.abs(place.step) * 256, 2.5 * 40, rtol=0.01)
    np.testing.assert_allclose(hands.wrists[0], [[0.2, -0.2, -0.2], [0.2, 0.2, 0.2]], atol=1e-6)


def test_a_checkpoint_with_objects_is_read_only_if_trusted(
    make_wilor,
):
    checkpoint = {"state_dict": {"gain": torch.ones(1)}, "hyper": Path("x")}
    with pytest.raises(BackendError, match="set the option trust_checkpoint = true"):
        make_wilor(checkpoint=checkpoint).load()
    make_wilor(checkpoint=checkpoint, trust_checkpoint=True).load()
