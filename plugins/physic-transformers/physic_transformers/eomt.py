"""Segment people, floor and portable objects with EoMT, a panoptic network trained on COCO."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from physic_core.adapters.networks import picture_tensor, to_numpy
from physic_core.adapters.pictures import IMAGENET_MEAN, IMAGENET_STD
from physic_core.errors import BackendError
from physic_core.interfaces import Options, Segmenter, Share
from physic_transformers.models import WEIGHTS_HELP, ModelOptions, ModelSpec, PretrainedBackend
from physic_transformers.panoptic import COCO_PANOPTIC, PaddedFrame, padded_input, people_and_floor

if TYPE_CHECKING:
    from collections.abc import Mapping

    from physic_core.types import People, UInt8Array


class EomtOptions(ModelOptions):
    """Settings of :class:`Eomt`."""

    weights: str = Field(default="eomt-large-640-hf", description=f"EoMT of COCO panoptic: {WEIGHTS_HELP}.")
    threshold: Share = Field(
        default=0.5, description="Chance from which a query's class is believed; 0.8 finds fewer, surely."
    )
    held: Share = Field(
        default=0.8, description="Share of its own mask that a query must win; 0.5 keeps more of a crowd."
    )


class Eomt(PretrainedBackend, Segmenter):
    """Segmenter: EoMT panoptic, in which each query predicts a class and a mask."""

    written_for = 1
    Options: ClassVar[type[Options]] = EomtOptions
    options: EomtOptions
    specs: ClassVar[tuple[ModelSpec, ...]] = (ModelSpec("weights", "EomtForUniversalSegmentation", ("eomt",)),)

    def build(self, device: str) -> Any:
        """Read the weights of a network that knows people."""
        found = super().build(device)
        class_names(found["weights"].config.id2label)
        return found

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, the floor, and portable objects.

        Raises:
            InputError: it is not a valid photo.
            BackendError: ``load`` was not called.
        """
        network, size = self.model(), (image.shape[0], image.shape[1])
        frame = _side(network.config.image_size)
        padded = PaddedFrame(*size, frame)
        shown = padded_input(image, padded)
        out = network.run(pixel_values=picture_tensor(shown, IMAGENET_MEAN, IMAGENET_STD, device=self.device))
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
    """Return a model's class names in order, or those of COCO panoptic if the config has only numbered labels.

    Raises:
        BackendError: people are not among them.
    """
    names = tuple(labels[i] for i in sorted(labels, key=int))
    if all(name == f"LABEL_{i}" for i, name in enumerate(names)) and len(names) == len(COCO_PANOPTIC):
        return COCO_PANOPTIC
    if "person" not in names:
        known = f"{len(names)} classes ({', '.join(names[:3])}, ...)"
        raise BackendError(
            f"this EoMT knows {known}, expected the {len(COCO_PANOPTIC)} of COCO panoptic, 'person' among them"
        )
    return names


def _side(size: Any) -> int:
    """Return the side of the network's input."""
    return int(size if isinstance(size, int) else size[0])
