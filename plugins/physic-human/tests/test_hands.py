"""WiLoR: what its network is shown, how answers are read, and the whole kit with a perfect network."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from physic_core.errors import BackendError
from physic_core.types import Keypoints, People
from physic_human.hands import mirror_rotvecs
from physic_human.wilor import Wilor, WilorOptions
from physic_testing.body_files import mano_arrays, write_published
from physic_testing.conformance import parametrize_with_checks
from physic_testing.conformance.hand_estimator import true_hands
from physic_testing.worlds import World

from .seen import CropsOnWorlds, Place, coordinates, nearest, network_of, pixels, place_of, wrist_turns

WRISTS = (20, 21)

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

WILOR_FILES = {"wilor_mini/__init__.py": "", "wilor_mini/models/mano.py": MANO, "wilor_mini/models/wilor.py": WILOR}


def keypoints(boxes: dict[str, list[float]]) -> tuple[People, Keypoints]:
    """One person with the 21 points of one or both hands on the edges of boxes, whole-body skeleton."""
    given = Keypoints(np.zeros((1, 133, 2)), np.zeros((1, 133)), "coco_wholebody133")
    for side, box in boxes.items():
        first = 91 if side == "left" else 112
        given.points[0, first : first + 21] = np.linspace(box[:2], box[2:], 21)
        given.confidence[0, first : first + 21] = 0.9
    return People(np.zeros((1, 200, 300), bool), np.array([[0.0, 0, 300, 200]]), np.ones(1)), given


def wilor_files(folder: Path) -> Path:
    folder.mkdir()
    torch.save(
        {"state_dict": {"gain": torch.full((1,), 0.5), "mano.faces": torch.zeros(2)}}, folder / "wilor_final.ckpt"
    )
    write_published(folder / "MANO_RIGHT.pkl", mano_arrays())
    (folder / "mano_mean_params.npz").write_bytes(b"")
    return folder


@pytest.fixture
def wilor(stub: Callable[..., Path], tmp_path: Path) -> Wilor:
    checkout = stub("wilor", WILOR_FILES)
    backend = Wilor(WilorOptions(checkout=str(checkout), weights=str(wilor_files(tmp_path / "files"))))
    backend.load()
    return backend


def test_wilor_can_repeat_the_papers_exchange_of_channels(stub: Callable[..., Path], tmp_path: Path) -> None:
    checkout = stub("w", WILOR_FILES)
    options = WilorOptions(checkout=str(checkout), weights=str(wilor_files(tmp_path / "f")), swap_channels=True)
    backend = Wilor(options)
    backend.load()
    image = np.zeros((200, 300, 3), np.uint8)
    image[:] = [200, 100, 10]
    backend.infer(image, *keypoints({"right": [100, 80, 140, 120]}))
    np.testing.assert_allclose(network_of(backend).seen[0][0, 128, 128], [200, 100, 10], atol=1)


def test_left_hands_are_shown_in_a_mirror_and_read_in_it(wilor: Wilor) -> None:
    picture = coordinates(200, 300)
    hands = wilor.infer(picture, *keypoints({"left": [60, 80, 100, 110], "right": [180, 80, 220, 110]}))
    left, right = (place_of(crop[..., ::-1], 200, 300) for crop in network_of(wilor).seen[0])
    assert left.mirrored
    assert not right.mirrored
    for place, middle in ((left, [79.5, 94.5]), (right, [199.5, 94.5])):
        np.testing.assert_allclose(place.at(0.5), middle, atol=0.8)
        np.testing.assert_allclose(np.abs(place.step) * 256, 2.5 * 40, rtol=0.01)
    assert hands.wrists is not None
    np.testing.assert_allclose(hands.wrists[0], [[0.2, -0.2, -0.2], [0.2, 0.2, 0.2]], atol=1e-6)


def test_large_hands_are_smoothed_before_they_are_made_small(wilor: Wilor) -> None:
    stripes = np.zeros((1300, 1300, 3), np.uint8)
    stripes[:, ::2] = 255
    wilor.infer(stripes, *keypoints({"right": [350, 350, 950, 950]}))
    seen = network_of(wilor).seen[0][0][60:200, 60:200]
    # 1500 px become 256: a blur of 0.96 px beforehand leaves next to nothing of stripes of one pixel.
    assert seen.std() < 6
    assert abs(seen.mean() - 127.5) < 2


def test_photos_are_not_wilors_to_change_and_hands_come_in_batches(wilor: Wilor) -> None:
    wilor.options = wilor.options.model_copy(update={"batch": 1})
    image = np.random.default_rng(0).integers(0, 255, (200, 300, 3)).astype(np.uint8)
    before = image.copy()
    hands = wilor.infer(image, *keypoints({"left": [60, 80, 100, 110], "right": [180, 80, 220, 110]}))
    np.testing.assert_array_equal(image, before)
    assert [len(seen) for seen in network_of(wilor).seen] == [1, 1]
    np.testing.assert_allclose(hands.confidence, 0.9, atol=1e-6)


def test_another_wilor_is_recognised_by_its_output(stub: Callable[..., Path], tmp_path: Path) -> None:
    text = WILOR[: WILOR.index("        return {")] + "        return pose, turned, None\n"
    checkout = stub("w", WILOR_FILES | {"wilor_mini/models/wilor.py": text})
    backend = Wilor(WilorOptions(checkout=str(checkout), weights=str(wilor_files(tmp_path / "f"))))
    backend.load()
    with pytest.raises(BackendError, match="WiLoR-mini's network returned tuple"):
        backend.infer(np.zeros((200, 300, 3), np.uint8), *keypoints({"left": [60, 80, 100, 110]}))


def test_a_checkpoint_with_objects_is_read_only_if_trusted(stub: Callable[..., Path], tmp_path: Path) -> None:
    files, checkout = wilor_files(tmp_path / "f"), stub("w", WILOR_FILES)
    torch.save({"state_dict": {"gain": torch.ones(1)}, "hyper": Path("x")}, files / "wilor_final.ckpt")
    with pytest.raises(BackendError, match="set the option trust_checkpoint = true"):
        Wilor(WilorOptions(checkout=str(checkout), weights=str(files))).load()
    Wilor(WilorOptions(checkout=str(checkout), weights=str(files), trust_checkpoint=True)).load()


class PerfectHands:
    """Answers the true hand at the place that a crop shows: right hands, and left ones as they look in a mirror."""

    def __init__(self) -> None:
        self.world: World | None = None
        self.size = (1, 1)

    def hand(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Fingers (15, 3) and the wrist (3,)."""
        if self.world is None:
            return np.full((15, 3), 0.1), np.zeros(3)
        side = 0 if place.mirrored else 1
        wrists = pixels(self.world.joints[:, WRISTS[side]], self.world)
        person = nearest(wrists, place.at(0.5))
        fingers = true_hands(self.world)[person, side].astype(float)
        turn = wrist_turns(self.world)[person, side]
        return (fingers, turn) if side else (mirror_rotvecs(fingers), mirror_rotvecs(turn))


class PerfectWilor(PerfectHands):
    def __call__(self, x: torch.Tensor) -> dict[str, torch.Tensor]:
        found = [self.hand(place_of(crop[..., ::-1].copy(), *self.size)) for crop in x.numpy()]
        fingers, wrists = (np.stack(part) for part in zip(*found, strict=True))
        return {"hand_pose": torch.from_numpy(fingers), "global_orient": torch.from_numpy(wrists[:, None])}


class WilorOnWorlds(CropsOnWorlds, Wilor):
    perfect_network = PerfectWilor


@parametrize_with_checks("hand_estimator", WilorOnWorlds, options={"least_size_px": 8}, capabilities={"exact"})
def test_wilor_conforms(check: Callable[[], None]) -> None:
    check()
