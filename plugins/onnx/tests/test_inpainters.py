"""LaMa: its three forms, the polarity of masks, and crops about holes."""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import pytest

from physic_core.errors import BackendError
from physic_onnx.lama import MOST_CROPS, Lama, hole_crops


@pytest.fixture(scope="module")
def photo():
    rng = np.random.default_rng(0)
    return cv2.GaussianBlur(rng.integers(0, 255, (90, 130, 3), np.uint8), (0, 0), 4)


@pytest.fixture(scope="module")
def mask():
    mask = np.zeros((90, 130), bool)
    mask[30:60, 50:80] = True
    return mask


@pytest.fixture
def lama(bound, stand_in_network):
    """LaMa's contract: paints half of the largest value that it sees where its mask is 1, or hands
    everything through.
    """

    def make(gain=255.0, size=(512, 512), *, paints=True):
        def answer(feed):
            image = feed["image"]
            half = image.max((2, 3), keepdims=True) / 2
            return {"output": gain * np.where(feed["mask"] * paints, half, image)}

        inputs = {"image": ("float32", ("b", 3, *size)), "mask": ("float32", ("b", 1, *size))}
        outputs = {"output": ("float32", ("b", 3, *size))}
        return bound(Lama, stand_in_network(inputs, answer, outputs))

    return make


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """LaMa as TorchScript, which refuses sizes that are not multiples of 8, and masks that are not
    0 or 1.
    """
    import torch

    class Stand(torch.nn.Module):
        def forward(self, image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            assert image.shape[2] % 8 == 0
            assert image.shape[3] % 8 == 0
            assert bool(((mask == 0) | (mask == 1)).all())
            paint = torch.amax(image, dim=[2, 3], keepdim=True) * 0.5
            return torch.where(mask > 0, paint.expand_as(image), image)

    path = tmp_path_factory.mktemp("script") / "big-lama.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.script(Stand()).save(str(path))
    return path


@pytest.mark.parametrize(
    "of",
    [{"gain": 255.0}, {"gain": 1.0}, {"size": ("h", "w")}, None],
    ids=["grey levels", "from 0 to 1", "of any size", "TorchScript"],
)
def test_lama_gets_1_in_the_hole_and_colours_from_0_to_1(lama, script, loaded, photo, mask, of):
    """Half of the brightest value of each channel: of 0..255, or with the mask the other way round,
    it would not be.
    """
    bright = photo // 2 + np.array([100, 60, 20], np.uint8)
    backend = loaded(Lama, script) if of is None else lama(**of)
    filled = backend.infer(bright, mask)
    assert (np.abs(filled[mask].astype(int) - bright.max((0, 1)) // 2) <= 2).all()
    assert (filled[~mask] == bright[~mask]).all()


@pytest.mark.parametrize(
    ("name", "words"), [("big-lama.pt", "as TorchScript"), ("lama.onnx", "broken or cut short")]
)
def test_a_file_without_a_network_is_refused(loaded, tmp_path, name, words):
    (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(BackendError, match=words):
        loaded(Lama, tmp_path / name)


@pytest.mark.parametrize("size", [(300, 400), (1400, 900), (97, 131)])
def test_inpainted_pixels_land_at_their_places(lama, size):
    """A network that hands everything through gives the photo back: crops, sizes and mirrors are
    undone.
    """
    y, x = np.mgrid[: size[0], : size[1]]
    smooth = np.stack(
        [120 + 100 * np.sin(x / 60), 120 + 100 * np.cos(y / 70), (x + y) / 12 % 255], -1
    ).astype(np.uint8)
    smooth[..., 2] = cv2.GaussianBlur(smooth[..., 2], (0, 0), 9)
    mask = np.zeros(size, bool)
    mask[size[0] // 3 : size[0] // 2, size[1] // 5 : size[1] // 3] = True
    filled = lama(paints=False).infer(smooth, mask)
    off = np.abs(filled.astype(int) - smooth)[mask]
    assert off.mean() < 1
    assert np.percentile(off, 99) <= 4


def test_far_holes_have_crops_of_their_own():
    hole = np.zeros((900, 1600), bool)
    hole[200:500, 100:200] = hole[400:700, 1400:1500] = True
    parts = hole_crops(hole, 512)
    assert len(parts) == 2
    assert (sum(own for own, _ in parts) == hole).all()
    for own, (y0, y1, x0, x1) in parts:
        assert own[y0:y1, x0:x1].sum() == own.sum() == 30000
        assert y1 - y0 == x1 - x0 == 600


def test_near_holes_share_a_crop_and_many_specks_have_few():
    near = np.zeros((900, 1600), bool)
    near[200:500, 100:200] = near[200:500, 230:330] = True
    specks = np.zeros((1200, 1200), bool)
    specks[::240, ::240] = True
    assert len(hole_crops(near, 512)) == 1
    assert 1 <= len(hole_crops(specks, 64)) <= MOST_CROPS


def test_a_crop_shows_more_than_holes():
    hole = np.zeros((400, 2000), bool)
    hole[:, :500] = hole[:, 700:1200] = True
    for _, (y0, y1, x0, x1) in hole_crops(hole, 64):
        assert (~hole[y0:y1, x0:x1]).mean() >= 0.3
