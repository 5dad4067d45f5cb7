"""DISK and LightGlue of kornia: local features of one image, and their matches in two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from physic_cameras.checkpoints import fill
from physic_core.adapters.pictures import normalized_nchw, resize_image
from physic_core.errors import BackendError

if TYPE_CHECKING:
    from pathlib import Path

    from physic_core.types import FloatArray, IntArray, UInt8Array

DISK_FILE, LIGHTGLUE_FILE = "depth-save.pth", "disk_lightglue.pth"
_DESCRIPTOR = 128
_WINDOW = 5


@dataclass(frozen=True)
class Features:
    """Local features of one image.

    Attributes:
        pixels: (n, 2) px of the image, integer coordinates are centres of pixels.
        descriptors: (n, D), whatever the matcher takes.
        size: width and height of the image, px.
    """

    pixels: FloatArray
    descriptors: Any
    size: tuple[int, int]

    def where(self, kept: Any) -> Features:
        """Return the features of a mask (n,)."""
        return Features(self.pixels[kept], self.descriptors[kept], self.size)


class Matcher(Protocol):
    """Finds and matches local features."""

    def features(self, image: UInt8Array) -> Features:
        """Return the features of an image (H, W, 3) uint8 RGB."""

    def match(self, one: Features, two: Features) -> IntArray:
        """Return the matches (m, 2): rows of the first features, and of the second."""


class DiskLightGlue:
    """The two networks, on one device.

    Args:
        folder: with their files, as their authors published them.
        device: of the networks.
        longest_px: images are reduced to this longer side.
        features: most of an image.

    Raises:
        BackendError: a file is not that of the network.
    """

    def __init__(self, folder: Path, device: str, *, longest_px: int, features: int) -> None:
        from kornia.feature import DISK, LightGlue

        self._device, self._longest_px, self._features = device, longest_px, features
        disk, lightglue = DISK(_DESCRIPTOR), LightGlue(None, input_dim=_DESCRIPTOR)
        published = _tensors(folder / DISK_FILE)
        fill(disk, published.get("extractor", published), folder / DISK_FILE)
        fill(lightglue, _current_names(_tensors(folder / LIGHTGLUE_FILE)), folder / LIGHTGLUE_FILE)
        self._disk, self._lightglue = disk.eval().to(device), lightglue.eval().to(device)

    def features(self, image: UInt8Array) -> Features:
        """Return the features of an image (H, W, 3) uint8 RGB, found in a reduced copy."""
        import torch

        height, width = image.shape[:2]
        scale = min(1.0, self._longest_px / max(height, width))
        rows, columns = max(1, round(height * scale)), max(1, round(width * scale))
        pixels = torch.from_numpy(normalized_nchw(resize_image(image, rows, columns, "bilinear-antialias"))).to(
            self._device
        )
        with torch.inference_mode():
            found = self._disk(pixels, n=self._features, window_size=_WINDOW, pad_if_not_divisible=True)[0]
        own = found.keypoints.cpu().numpy().astype(np.float64)
        return Features((own + 0.5) * [width / columns, height / rows] - 0.5, found.descriptors, (width, height))

    def match(self, one: Features, two: Features) -> IntArray:
        """Return the matches (m, 2): rows of the first features, and of the second."""
        import torch

        if not len(one.pixels) or not len(two.pixels):
            return np.zeros((0, 2), np.int64)
        given = {
            f"image{k}": {
                "keypoints": torch.from_numpy(some.pixels).to(some.descriptors)[None],
                "descriptors": some.descriptors[None],
                "image_size": torch.tensor([some.size], device=self._device),
            }
            for k, some in enumerate((one, two))
        }
        with torch.inference_mode():
            found: IntArray = self._lightglue(given)["matches"][0].cpu().numpy()
        return found


def _tensors(path: Path) -> dict[str, Any]:
    """Read a checkpoint without running code that it may hold.

    Raises:
        BackendError: it is not one.
    """
    import torch

    try:
        return dict(torch.load(path, map_location="cpu", weights_only=True))
    except Exception as error:  # whatever a file can be instead
        raise BackendError(
            f"{path} cannot be read as a checkpoint of torch: {type(error).__name__}: {error}"
        ) from error


def _current_names(state: dict[str, Any]) -> dict[str, Any]:
    """Return tensors of LightGlue's release under the names of today's class: its blocks once lay in two lists."""
    named = {}
    for name, tensor in state.items():
        kind, _, rest = name.partition(".")
        number, _, inner = rest.partition(".")
        named[f"transformers.{number}.{kind}.{inner}" if kind in ("self_attn", "cross_attn") else name] = tensor
    return named
