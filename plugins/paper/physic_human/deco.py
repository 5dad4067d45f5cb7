"""Predict contact on SMPL vertices with a checkout of DECO (Tripathi et al. 2023).

It was trained on images read by OpenCV. So channels are in the order blue, green, red, but mean and
standard deviation of ImageNet keep their RGB order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import ContactPrior
from physic_core.types import ContactProbability
from physic_human.smpl_backends import SmplCheckoutBackend, SmplCheckoutOptions, open_smpl
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP
from physic_networks.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from physic_core.types import Bodies, FloatArray, People, RestMesh, UInt8Array

INPUT_SIDE = 256
"""Height and width of the network's square input, px."""
BOX_GROWTH = 0.1
"""Share of its width and height by which a box is enlarged on every side."""
_WHITE = 255
SMPL_VERTICES = 6890


def enlarged_box_slices(box: FloatArray, height: int, width: int) -> tuple[slice, slice]:
    """Enlarge a box (4,) x0 y0 x1 y1 px, clip it to the image, and return its row and column
    slices.
    """
    x0, y0, x1, y1 = (float(v) for v in box)
    dx = BOX_GROWTH * (x1 - x0)
    dy = BOX_GROWTH * (y1 - y0)
    return _clipped_slice(y0 - dy, y1 + dy, height), _clipped_slice(x0 - dx, x1 + dx, width)


def contact_crop(image: UInt8Array, box: FloatArray) -> FloatArray:
    """Return the network input (3, 256, 256) float32 for one person, with white beside it.

    Args:
        image: (H, W, 3) uint8 RGB.
        box: (4,) x0 y0 x1 y1 px, half open.
    """
    import cv2

    rows, columns = enlarged_box_slices(box, image.shape[0], image.shape[1])
    cut = np.ascontiguousarray(image[rows, columns, ::-1])
    height, width = cut.shape[:2]
    scale = INPUT_SIDE / max(height, width)
    size = (max(int(width * scale), 1), max(int(height * scale), 1))
    small = cv2.resize(cut, size, interpolation=cv2.INTER_CUBIC)
    square = np.full((INPUT_SIDE, INPUT_SIDE, 3), _WHITE, np.uint8)
    left = (INPUT_SIDE - size[0]) // 2
    top = (INPUT_SIDE - size[1]) // 2
    square[top : top + size[1], left : left + size[0]] = small
    # The RGB mean and deviation are applied to BGR channels, as in the training of these networks.
    pixels: FloatArray = normalized_nchw(square, IMAGENET_MEAN, IMAGENET_STD)[0]
    return pixels


def _clipped_slice(low: float, high: float, end: int) -> slice:
    """Return a slice from ``low`` to ``high``, clipped to [0, end) and at least 1 long."""
    first = min(max(int(low), 0), end - 1)
    return slice(first, max(min(int(high), end), first + 1))


class DecoOptions(SmplCheckoutOptions):
    """Settings of DECO."""

    weights: str = Field("deco", description=WEIGHTS_HELP)
    smpl_file: str = Field(
        default="",
        description="your SMPL_NEUTRAL.npz or .pkl, whose T-pose maps the "
        "labels to your body model",
    )


class Deco(SmplCheckoutBackend, ContactPrior):
    """Contact prior by DECO: contact with any object, threshold 0.5."""

    written_for = 1
    Options = DecoOptions
    options: DecoOptions
    reads = ("people",)
    project = Checkout(
        name="DECO",
        package="models.deco",
        homepage="https://github.com/sha2nkt/deco",
        commit="d1061cef2ae94c3364ba5c9338eea58d654acd77",
        needs=("torchvision", "yacs", "loguru"),
    )

    def build(self, device: str) -> tuple[Any, RestMesh | None]:
        """Return the network with its weights, and SMPL's T-pose if its file is given."""
        path = self.file()
        kind = self.checkout.attribute("DECO")
        smpl = self.options.smpl_file
        rest = open_smpl(smpl).rest if smpl else None
        with self.inference():
            network = kind("hrnet", True, device)  # encoder, whether it looks at the context too
            return self.load_checkpoint_into(network, path, "deco"), rest

    def preprocess(
        self, image: UInt8Array, people: People, bodies: Bodies
    ) -> dict[str, FloatArray]:
        """Crop the people."""
        crops = [contact_crop(image, box) for box in people.boxes]
        return {"img": np.array(crops, np.float32)}

    def run_network(self, inputs: dict[str, torch.Tensor]) -> Sequence[Any]:
        """Run the network on crops."""
        return [self.network[0](inputs["img"])[0]]

    def postprocess(
        self, outputs: list[FloatArray], image: UInt8Array, people: People, bodies: Bodies
    ) -> ContactProbability:
        """Return the contact probability (N, 6890) on SMPL vertices of N people."""
        probabilities = outputs[0] if outputs else np.zeros((0, SMPL_VERTICES), np.float32)
        if probabilities.shape != (len(people), SMPL_VERTICES):
            raise BackendError(
                f"DECO returned {probabilities.shape}, expected ({len(people)}, {SMPL_VERTICES})"
            )
        return ContactProbability(np.clip(probabilities, 0, 1), "smpl", self.network[1])
