"""LaMa: the polarity of its mask, its range, and the sizes that it takes."""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import pytest
import torch

from physic_core.errors import BackendError
from physic_human.lama import Lama


class Paint(torch.nn.Module):
    """Paints half of the brightest value of each channel where its mask is 1."""

    def forward(self, image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        assert image.shape[2] % 8 == 0
        assert image.shape[3] % 8 == 0
        assert bool(((mask == 0) | (mask == 1)).all())
        half = torch.amax(image, dim=[2, 3], keepdim=True) * 0.5
        return torch.where(mask > 0, half.expand_as(image), image)


@pytest.fixture(scope="module")
def lama(tmp_path_factory):
    """The backend with a TorchScript file of that network."""
    path = tmp_path_factory.mktemp("script") / "big-lama.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.script(Paint()).save(str(path))
    backend = Lama()
    backend.file = lambda: path
    backend.load()
    return backend


def test_the_hole_is_1_and_colours_are_from_0_to_1(lama):
    rng = np.random.default_rng(0)
    photo = cv2.GaussianBlur(rng.integers(0, 255, (90, 130, 3), np.uint8), (0, 0), 4)
    photo = photo // 2 + np.array([100, 60, 20], np.uint8)
    mask = np.zeros((90, 130), bool)
    mask[30:60, 50:80] = True
    filled = lama.infer(photo, mask)
    assert (np.abs(filled[mask].astype(int) - photo.max((0, 1)) // 2) <= 2).all()
    assert (filled[~mask] == photo[~mask]).all()


@pytest.mark.parametrize("size", [(300, 400), (1700, 900), (97, 131)])
def test_filled_pixels_land_at_their_places(lama, size, monkeypatch):
    """A network that hands everything through gives the photo back."""
    monkeypatch.setattr(lama, "_network", lambda image, mask: image)
    y, x = np.mgrid[: size[0], : size[1]]
    smooth = (120 + 100 * np.sin(np.stack([x, y, x + y], -1) / 70)).astype(np.uint8)
    mask = np.zeros(size, bool)
    mask[size[0] // 3 : size[0] // 2, size[1] // 5 : size[1] // 3] = True
    off = np.abs(lama.infer(smooth, mask).astype(int) - smooth)[mask]
    assert off.max() <= 2


def test_a_file_that_is_no_torchscript_is_refused(tmp_path):
    backend = Lama()
    (tmp_path / "big-lama.pt").write_bytes(b"nothing")
    backend.file = lambda: tmp_path / "big-lama.pt"
    with pytest.raises(BackendError, match="as TorchScript"):
        backend.load()
