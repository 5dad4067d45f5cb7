"""Segment people with SAM 2 in the boxes of the embedded segmenter, and the floor at their feet."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core import find_backend, load_backend
from physic_core.errors import BackendNotFoundError
from physic_core.interfaces import Segmenter
from physic_networks.networks import WEIGHTS_HELP, NetworkBackend

from .sessions import OnnxOptions

if TYPE_CHECKING:
    from physic_core.types import BoolArray, People, UInt8Array

    from .sam2_networks import Sam2Networks

DETECTOR = "metricbody-embedded:embedded"
"""Segmenter whose boxes, joints, and surfaces are used."""


class Sam2Options(OnnxOptions):
    """Settings of Sam2."""

    weights: str = Field("sam2-hiera-tiny", description=WEIGHTS_HELP)


class Sam2(NetworkBackend, Segmenter):
    """Segmenter: SAM 2 tiny in the boxes of the embedded segmenter.

    The photo is encoded once for all people and the floor.
    """

    written_for = 1
    Options = Sam2Options
    options: Sam2Options

    def build(self, device: str) -> tuple[Sam2Networks, Any]:
        """Open the encoder, the decoder and the embedded segmenter."""
        from .sam2_networks import open_sam2

        detector = load_backend("segmenter", DETECTOR, device=device, threads=self.options.threads)
        return open_sam2(self.file(), self.options, device), detector

    def close(self) -> None:
        """Close the networks."""
        if self._network is not None:
            self._network[1].close()
        super().close()

    def missing(self) -> tuple[str, ...]:
        """Describe the missing files of encoder and decoder, or the missing plugin."""
        try:
            find_backend("segmenter", DETECTOR)
        except BackendNotFoundError as error:
            return (*super().missing(), str(error).partition("\n")[0])
        return super().missing()

    def fingerprint(self) -> str:
        """Return the checksums of the weights, and the version of the embedded segmenter."""
        return f"{super().fingerprint()} {find_backend('segmenter', DETECTOR).owner}"

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, and the floor.

        Raises:
            InputError: it is not a valid photo.
            BackendError: load() was not called, or a network fails.
        """
        from physic_networks.people import Detections, mask_nms, people_from_masks
        from physic_networks.pictures import resize_map

        from .sam2_floor import floor_mask

        networks, detector = self.network
        detected: People = detector.infer(image)
        if not len(detected):
            return detected
        size = (image.shape[0], image.shape[1])
        boxes = Detections(detected.boxes, detected.scores, detected.keypoints)
        photo = networks.encode(image)
        three, fits = networks.masks_from_boxes(photo, boxes.boxes)
        logits = three[np.arange(len(three)), fits.argmax(axis=1)]
        rows = mask_nms(logits > 0, boxes.scores)
        boxes, logits = boxes[rows], logits[rows]
        people = people_from_masks(
            (resize_map(grid, *size) for grid in logits),
            boxes.boxes,
            boxes.scores,
            size=size,
            keypoints=boxes.keypoints,
        )
        return _with_rest(replace(people, floor=floor_mask(networks, photo, people)), detected)


def _with_rest(people: People, detected: People) -> People:
    """Return the people with the floor, surfaces, unposed people and carriers of the embedded
    segmenter.
    """
    anybody: BoolArray = np.asarray(people.masks.any(axis=0))
    floors = [floor for floor in (people.floor, detected.floor) if floor is not None]
    unposed = None if detected.unposed_mask is None else detected.unposed_mask & ~anybody
    blocked = anybody if unposed is None else anybody | unposed
    return replace(
        people,
        floor=np.asarray(np.logical_or.reduce(floors)) & ~blocked if floors else None,
        surfaces=detected.surfaces,
        unposed=detected.unposed,
        unposed_mask=unposed,
        carriers=detected.carriers,
    )
