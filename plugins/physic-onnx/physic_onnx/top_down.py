"""Helpers for networks that see one person or hand at a time: crops, batches and joint sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.adapters.networks import run_in_batches
from physic_core.errors import BackendError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.top_down import Crop
    from physic_core.types import FloatArray, UInt8Array

    from .one_graph import LoadedGraph

SKELETON_BY_JOINTS: dict[int, str] = {17: "coco17", 23: "coco23", 26: "halpe26", 133: "coco_wholebody133"}
"""Number of joints -> skeleton name."""


def skeleton_name(count: int, file: str) -> str:
    """Return the skeleton name of a network with ``count`` joints.

    Raises:
        BackendError: none that people have.
    """
    if count in SKELETON_BY_JOINTS:
        return SKELETON_BY_JOINTS[count]
    known = ", ".join(f"{number} ({name})" for number, name in SKELETON_BY_JOINTS.items())
    hint = "; 21 joints are those of one hand" if count == 21 else ""
    raise BackendError(f"{file} returns {count} keypoints a person, and known are {known}{hint}: choose another file")


def size_or_default(size: int | str, otherwise: int) -> int:
    """Return ``size`` if it is a fixed number, else the default ``otherwise``."""
    return size if isinstance(size, int) and size > 0 else otherwise


def crop_batch(image: UInt8Array, crops: Sequence[Crop], *, bgr: bool = False) -> FloatArray:
    """Crop network inputs (N, 3, h, w) float32, normalised with ImageNet's mean and standard deviation.

    Args:
        image: (H, W, 3) uint8 RGB.
        crops: N of one size.
        bgr: exchange red and blue first; mean and deviation stay where they are.
    """

    from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw
    from physic_core.adapters.top_down import resample_crop

    cuts = [resample_crop(image, crop) for crop in crops]
    return np.concatenate([normalized_nchw(c[..., ::-1] if bgr else c, IMAGENET_MEAN, IMAGENET_STD) for c in cuts])


def run_batches(
    loaded: LoadedGraph, feed: Mapping[str, NDArray[Any]], outputs: Sequence[str], most: int = 8
) -> list[NDArray[Any]]:
    """Run a network over N rows in batches.

    Args:
        loaded: the network; a file that fixes its batch gets batches of that size.
        feed: input, by the adapter's name -> (N, ...), N > 0.
        outputs: by the adapter's names.
        most: rows at a time where the file leaves the batch free.

    Raises:
        BackendError: it fails, or answers another number of rows.
    """
    firsts = [shape[0] for name in feed if (shape := loaded.input_shape(name))]
    fixed = [first for first in firsts if isinstance(first, int) and first > 0]

    def call(part: dict[str, NDArray[Any]]) -> list[NDArray[Any]]:
        return loaded.ports.run(loaded.network, part, outputs)

    return run_in_batches(call, feed, fixed[0] if fixed else most, full=bool(fixed))
