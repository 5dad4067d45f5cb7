"""What networks share that look at one person, or one hand, at a time: many crops a run, and what their joints are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.errors import BackendError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.crops import Crop
    from physic_core.types import FloatArray, UInt8Array

    from .one_graph import Speaking

__all__ = ["SKELETON_OF", "fixed_or", "held", "pictures_of", "run_rows", "skeleton_of"]

SKELETON_OF: dict[int, str] = {17: "coco17", 23: "coco23", 26: "halpe26", 133: "coco_wholebody133"}
"""How many joints a person's network answers -> their joint set."""


def skeleton_of(count: int, file: str) -> str:
    """The joint set of a network that answers ``count`` joints.

    Raises:
        BackendError: none that people have.
    """
    if count in SKELETON_OF:
        return SKELETON_OF[count]
    known = ", ".join(f"{number} ({name})" for number, name in SKELETON_OF.items())
    hint = "; 21 joints are those of one hand" if count == 21 else ""
    raise BackendError(f"{file} answers {count} keypoints a person, and known are {known}{hint}: choose another file")


def fixed_or(size: int | str, otherwise: int) -> int:
    """The size that a file fixes, or another where it leaves it free."""
    return size if isinstance(size, int) and size > 0 else otherwise


def pictures_of(
    image: UInt8Array,
    crops: Sequence[Crop],
    *,
    bgr: bool = False,
    fill: int = 0,
    sigmas: Sequence[float] | None = None,
) -> FloatArray:
    """What the network sees of each crop: (N, 3, h, w) float32, normalised by ImageNet's mean and deviation.

    Args:
        image: (H, W, 3) uint8 RGB.
        crops: N of one size.
        bgr: exchange red and blue first; mean and deviation stay where they are.
        fill: value outside of the photo.
        sigmas: px of the photo, of a blur before each crop.
    """

    from physic_core.adapters.crops import resample_crop
    from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, normalized_nchw

    blurs = [0.0] * len(crops) if sigmas is None else sigmas
    cuts = [resample_crop(image, crop, fill=fill, sigma=sigma) for crop, sigma in zip(crops, blurs, strict=True)]
    return np.concatenate([normalized_nchw(c[..., ::-1] if bgr else c, IMAGENET_MEAN, IMAGENET_STD) for c in cuts])


def run_rows(
    speaking: Speaking, feed: Mapping[str, NDArray[Any]], outputs: Sequence[str], most: int = 8
) -> list[NDArray[Any]]:
    """Run a network over N rows, as many at a time as the file and memory allow.

    Args:
        speaking: the network; a file that fixes its batch gets batches of that size.
        feed: input, by the adapter's name -> (N, ...), N > 0.
        outputs: by the adapter's names.
        most: rows at a time where the file leaves the batch free.

    Raises:
        BackendError: it fails, or answers another number of rows.
    """

    rows = len(next(iter(feed.values())))
    size = min([fixed_or(speaking.shape(name)[0], most) for name in feed if speaking.shape(name)])
    fixed = any(isinstance(speaking.shape(name)[0], int) for name in feed if speaking.shape(name))
    found: list[list[NDArray[Any]]] = []
    for start in range(0, rows, size):
        part = {name: value[start : start + size] for name, value in feed.items()}
        count = len(next(iter(part.values())))
        if fixed and count < size:
            part = {name: np.concatenate([v, np.repeat(v[-1:], size - count, axis=0)]) for name, v in part.items()}
        answers = speaking.ports.run(speaking.network, part, outputs)
        for name, answer in zip(outputs, answers, strict=True):
            if answer.ndim == 0 or len(answer) != len(next(iter(part.values()))):
                raise BackendError(
                    f"{speaking.network.name} was shown {len(next(iter(part.values())))} pictures and answered "
                    f"{name} {answer.shape}: it does not keep its batch; export it with a free first axis, or with 1"
                )
        found.append([answer[:count] for answer in answers])
    return [np.concatenate(parts) for parts in zip(*found, strict=True)]


def held(speaking: Speaking, feed: Mapping[str, NDArray[Any]], outputs: Sequence[str]) -> list[NDArray[Any]]:
    """Outputs that are the same whatever is shown, as files exported here carry a mesh with them.

    Nothing but these is computed.
    """

    rows = {name: fixed_or((speaking.shape(name) or (1,))[0], 1) for name in feed}
    return speaking.ports.run(
        speaking.network, {name: np.repeat(value[:1], rows[name], axis=0) for name, value in feed.items()}, outputs
    )
