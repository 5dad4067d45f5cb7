"""Remove people from a photo with MI-GAN."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.interfaces import Inpainter, Options
from physic_embedded.networks.sessions import PackagedBackend, Threads
from physic_networks.pictures import inpaint_masked

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array

_NETWORK_SIZE = 512
_MARGIN = 128  # px of the photo on each side of the hole that the network sees
_EDGE = np.exp(-0.25 * np.arange(-2.0, 3.0) ** 2)
_EDGE /= _EDGE.sum()  # the weights, along one axis, of the blur between photo and fill
_RIM = 0.004  # of the long side: the fill takes on the colours of what is removed at its edge


class MiGanOptions(Options):
    """Settings of :class:`MiGan`."""

    threads: Threads = 2


class MiGan(PackagedBackend, Inpainter):
    """MI-GAN inpainter for 512 px, trained on Places2.

    It runs on a crop around the hole, for any photo size.

    The fill is sharp for holes up to about 512 px across and gets blurred above that. With little
    known around the hole, the fill is invented. A hole much larger than the person may be filled
    with an invented figure, so dilate little: 0.4 to 1.2 % of the photo's long side.
    """

    written_for = 1
    weights_license = "MIT (MI-GAN)"
    Options = MiGanOptions
    options: MiGanOptions

    networks = ("migan_512_places2",)

    def close(self) -> None:
        """Release the network and its working memory, whose pieces fit no other network."""
        super().close()
        self.release_memory()

    def infer(self, image: UInt8Array, mask: BoolArray) -> UInt8Array:
        """Fill the mask (H, W), True = remove, in an image (H, W, 3); pixels outside the mask stay
        identical.

        Raises:
            BackendError: the mask has another size, or covers the whole image.
        """
        return inpaint_masked(image, mask, _RIM, self._fill)

    def _fill(self, image: UInt8Array, hole: BoolArray) -> UInt8Array:
        """Fill the hole (H, W) in an image (H, W, 3), with soft edges: pixels near it change
        too.
        """
        import cv2

        filled = image.copy()
        part = _crop(hole)
        visible = image[part].astype(np.float32)
        known = np.where(hole[part], 0, 255).astype(np.uint8)
        size = (_NETWORK_SIZE, _NETWORK_SIZE)
        small = np.rint(cv2.resize(visible, size, interpolation=cv2.INTER_LINEAR))
        small_known = cv2.resize(known, size, interpolation=cv2.INTER_NEAREST).astype(np.float32)
        inputs = {
            "image": np.ascontiguousarray(small.transpose(2, 0, 1)[None]),
            "known": small_known[None, None],
        }
        (made,) = self.network["migan_512_places2"].run(["filled"], inputs)
        planes = np.ascontiguousarray(made[0].transpose(1, 2, 0))
        large = cv2.resize(planes, known.shape[::-1], interpolation=cv2.INTER_LINEAR)
        soft = cv2.dilate(known, np.ones((3, 3), np.uint8)).astype(np.float32) / 255
        share = cv2.sepFilter2D(soft, -1, _EDGE, _EDGE, borderType=cv2.BORDER_REFLECT_101)[
            ..., None
        ]
        large += (visible - large) * share
        filled[part] = np.clip(large, 0, 255)
        return filled


def _crop(hole: BoolArray) -> tuple[slice, slice]:
    """Return rows and columns of the part that the network sees: a square round the hole, as far as
    the photo goes.
    """
    bounds = [np.flatnonzero(hole.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    side = max(_NETWORK_SIZE, 2 * _MARGIN + max(int(last - first) for first, last in bounds))
    parts = []
    for (first, last), length in zip(bounds, hole.shape, strict=True):
        centre = (int(first) + int(last)) // 2
        half = (side + 1) // 2
        start = centre - half
        stop = centre + half
        if start < 0:
            start = 0
            stop = min(side, length)
        elif stop > length:
            start = max(length - side, 0)
            stop = length
        parts.append(slice(start, stop))
    return parts[0], parts[1]
