"""Segment people, floor and portable objects with EoMT, a panoptic network trained on COCO.

A query has a class and a mask. Each pixel belongs to the query with the largest product of class
and mask probability.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.networks import picture_tensor, to_numpy
from physic_core.adapters.people import people_from_masks, sigmoid
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD, resize_image, resize_map
from physic_core.errors import BackendError
from physic_core.interfaces import Options, Segmenter, Share
from physic_transformers.models import WEIGHTS_HELP, ModelOptions, ModelSpec, PretrainedBackend

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from physic_core.types import BoolArray, FloatArray, People, UInt8Array

COCO_PANOPTIC: tuple[str, ...] = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat",
    "traffic light", "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog",
    "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella",
    "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard", "sports ball", "kite",
    "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange",
    "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant",
    "bed", "dining table", "toilet", "tv", "laptop", "mouse", "remote", "keyboard", "cell phone",
    "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase", "scissors",
    "teddy bear", "hair drier", "toothbrush", "banner", "blanket", "bridge", "cardboard", "counter",
    "curtain", "door-stuff", "floor-wood", "flower", "fruit", "gravel", "house", "light",
    "mirror-stuff", "net", "pillow", "platform", "playingfield", "railroad", "river", "road",
    "roof", "sand", "sea", "shelf", "snow", "stairs", "tent", "towel", "wall-brick", "wall-stone",
    "wall-tile", "wall-wood", "water-other", "window-blind", "window-other", "tree-merged",
    "fence-merged", "ceiling-merged", "sky-other-merged", "cabinet-merged", "table-merged",
    "floor-other-merged", "pavement-merged", "mountain-merged", "grass-merged", "dirt-merged",
    "paper-merged", "food-other-merged", "building-other-merged", "rock-merged",
    "wall-other-merged", "rug-merged",
)  # fmt: skip
"""The 133 classes of COCO panoptic in the order of network outputs: 80 things, then 53 stuff
classes.
"""

FLOOR_CLASSES = frozenset(
    (
        "floor-wood", "floor-other-merged", "rug-merged", "pavement-merged", "road", "grass-merged",
        "dirt-merged", "sand", "snow", "platform", "playingfield", "gravel",
    )
)  # fmt: skip
"""COCO panoptic classes of surfaces that people can stand on."""

PORTABLE_CLASSES = frozenset(
    (
        "backpack", "umbrella", "handbag", "suitcase", "frisbee", "sports ball", "kite",
        "baseball bat", "baseball glove", "tennis racket", "bottle", "wine glass", "cup", "fork",
        "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange", "broccoli", "carrot",
        "hot dog", "pizza", "donut", "cake", "laptop", "mouse", "remote", "keyboard", "cell phone",
        "book", "vase", "scissors", "teddy bear", "hair drier", "toothbrush",
    )
)  # fmt: skip
"""COCO panoptic things that one person can carry, without those that people stand on (skateboard,
skis).
"""


class PaddedFrame:
    """Size of a photo after resizing it to fit a square frame, padded below or at the right.

    Attributes:
        height: of the photo, px.
        width: of the photo, px.
        frame: side of the square, px.
        inner: height and width of the resized photo in the frame's top left corner, px.
    """

    def __init__(self, height: int, width: int, frame: int) -> None:
        self.height = height
        self.width = width
        self.frame = frame
        short = min(height, width)
        long = max(height, width)
        # The networks' own processors round the short side and cut the other.
        exact = frame * short / long
        sides = (
            (frame, frame) if short == long else (max(1, round(exact)), int(exact * long / short))
        )
        self.inner = sides if height <= width else sides[::-1]

    def to_photo(self, grid: FloatArray) -> FloatArray:
        """Resample a map (h, w) of the square frame to (H, W) float32 pixels of the photo,
        bilinear.
        """
        full = resize_map(grid, self.frame, self.frame)
        return resize_map(full[: self.inner[0], : self.inner[1]], self.height, self.width)


def padded_input(image: UInt8Array, padded: PaddedFrame) -> UInt8Array:
    """Return a photo in a square (S, S, 3); the padding is black."""
    square = np.zeros((padded.frame, padded.frame, 3), np.uint8)
    square[: padded.inner[0], : padded.inner[1]] = resize_image(
        image, *padded.inner, "bilinear-antialias"
    )
    return square


def people_and_floor(
    class_logits: FloatArray,
    mask_logits: FloatArray,
    to_photo: Callable[[FloatArray], FloatArray],
    size: tuple[int, int],
    *,
    labels: Sequence[str] = COCO_PANOPTIC,
    threshold: float = 0.5,
    held: float = 0.8,
    smallest: int = 1,
) -> People:
    """Compute masks of people, of the floor and of portable objects from panoptic queries.

    Args:
        class_logits: (Q, C + 1); the last class is "no object".
        mask_logits: (Q, h, w), above 0 inside.
        to_photo: (h, w) of one query -> (H, W) of the photo.
        size: H and W of the photo, px.
        labels: names of the C classes; people are "person", floor classes are those in
            ``FLOOR_CLASSES``, objects those in ``PORTABLE_CLASSES``.
        threshold: queries with a lower class probability are ignored.
        held: minimum share of its own mask that a query must win; otherwise it counts as a part of
            others.
        smallest: people with fewer px are skipped.

    Returns:
        The people, with ``objects`` None if no class of ``labels`` is portable.

    Raises:
        ValueError: C is not the number of labels.
    """
    if class_logits.shape[-1] != len(labels) + 1:
        raise ValueError(
            f"expected {len(labels)} classes and none, got {class_logits.shape[-1]} numbers a query"
        )
    class_probability = _softmax(np.asarray(class_logits, np.float64))
    label = class_probability.argmax(axis=1)
    score = class_probability.max(axis=1)
    candidates = np.flatnonzero((label < len(labels)) & (score > threshold))
    owner = np.full(size, -1, np.int16)
    strongest = np.zeros(size, np.float32)
    sure = np.zeros(size, bool)
    own_area = {}
    for q in candidates:
        probability = sigmoid(to_photo(mask_logits[q]))
        own_area[q] = int((probability >= 0.5).sum())
        claim = np.float32(score[q]) * probability
        wins = claim > strongest
        owner[wins], strongest[wins], sure[wins] = q, claim[wins], probability[wins] >= 0.5
    segments = [q for q in candidates if own_area[q] and (owner == q).sum() > held * own_area[q]]
    people = [q for q in segments if labels[label[q]] == "person"]
    floor: BoolArray = np.zeros(size, bool)
    for q in segments:
        if labels[label[q]] in FLOOR_CLASSES:
            floor |= (owner == q) & sure
    objects = None
    if not PORTABLE_CLASSES.isdisjoint(labels):
        masks = [(owner == q) & sure for q in segments if labels[label[q]] in PORTABLE_CLASSES]
        objects = np.array(masks, bool).reshape(-1, *size)
    found = people_from_masks(
        ((owner == q) & sure for q in people),
        None,
        score[people],
        floor,
        size=size,
        smallest=smallest,
    )
    return replace(found, objects=objects)


def _softmax(logits: FloatArray) -> FloatArray:
    """Return the softmax over the last axis."""
    shifted = np.exp(logits - logits.max(axis=-1, keepdims=True))
    share: FloatArray = shifted / shifted.sum(axis=-1, keepdims=True)
    return share


class EomtOptions(ModelOptions):
    """Settings of :class:`Eomt`."""

    weights: str = Field(
        default="eomt-large-640-hf", description=f"EoMT of COCO panoptic: {WEIGHTS_HELP}."
    )
    threshold: Share = Field(
        default=0.5,
        description="Chance from which a query's class is believed; 0.8 finds fewer, surely.",
    )
    held: Share = Field(
        default=0.8,
        description="Share of its own mask that a query must win; 0.5 keeps more of a crowd.",
    )


class Eomt(PretrainedBackend, Segmenter):
    """Segmenter: EoMT panoptic, in which each query predicts a class and a mask."""

    written_for = 1
    Options: ClassVar[type[Options]] = EomtOptions
    options: EomtOptions
    specs: ClassVar[tuple[ModelSpec, ...]] = (
        ModelSpec("weights", "EomtForUniversalSegmentation", ("eomt",)),
    )

    def build(self, device: str) -> Any:
        """Read the weights of a network that knows people."""
        found = super().build(device)
        class_names(found["weights"].config.id2label)
        return found

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, the floor, and portable
        objects.

        Raises:
            InputError: it is not a valid photo.
            BackendError: ``load`` was not called.
        """
        network = self.model()
        size = (image.shape[0], image.shape[1])
        frame = _side(network.config.image_size)
        padded = PaddedFrame(*size, frame)
        shown = padded_input(image, padded)
        out = network.run(
            pixel_values=picture_tensor(shown, IMAGENET_MEAN, IMAGENET_STD, device=self.device)
        )
        return people_and_floor(
            to_numpy(out.class_queries_logits)[0],
            to_numpy(out.masks_queries_logits)[0],
            padded.to_photo,
            size,
            labels=class_names(network.config.id2label),
            threshold=self.options.threshold,
            held=self.options.held,
        )


def class_names(labels: Mapping[Any, str]) -> tuple[str, ...]:
    """Return a model's class names in order, or those of COCO panoptic if the config has only
    numbered labels.

    Raises:
        BackendError: people are not among them.
    """
    names = tuple(labels[i] for i in sorted(labels, key=int))
    if all(name == f"LABEL_{i}" for i, name in enumerate(names)) and len(names) == len(
        COCO_PANOPTIC
    ):
        return COCO_PANOPTIC
    if "person" not in names:
        known = f"{len(names)} classes ({', '.join(names[:3])}, ...)"
        raise BackendError(
            f"this EoMT knows {known}, expected the {len(COCO_PANOPTIC)} of COCO panoptic, "
            f"'person' among them"
        )
    return names


def _side(size: Any) -> int:
    """Return the side of the network's input."""
    return int(size if isinstance(size, int) else size[0])
