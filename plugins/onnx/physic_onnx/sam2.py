"""Segment people with SAM 2 in the boxes of a detector, and the floor at their feet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core import find_backend, load_backend
from physic_core.errors import BackendError, BackendNotFoundError, PhysicError
from physic_core.interfaces import Options, Segmenter, Share
from physic_core.weights import fingerprint, missing
from physic_networks.networks import NetworkBackend

from .sessions import OnnxOptions

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People, UInt8Array

    from .detectors import Detector
    from .sam2_networks import Sam2Networks

EMBEDDED = "embedded"
"""Value of the option ``detector``: boxes, joints and surfaces of the segmenter in the wheel of
metricbody-embedded.
"""
_SEGMENTER = "metricbody-embedded:embedded"
_OVERLAP = 0.65  # IoU from which two boxes are one person
_LEAST_HEIGHT_PX = 24.0  # of a box; lower people are omitted


class Sam2Options(OnnxOptions):
    """Settings of Sam2."""

    weights: str = Field(
        "sam2.1-hiera-tiny",
        description="a name of `physic weights list`, or a folder of your own with an encoder and "
        "a decoder; "
        "small, base-plus and large are better at hair and fingers, and slower",
    )
    variant: str = Field(
        "", description="of the encoder's file, such as fp16 or quantized; empty for the plain one"
    )
    detector: str = Field(
        "rtdetr-r50",
        description="detector of people: YOLOX, RT-DETR, D-FINE or RTMO, a name of `physic "
        "weights list` or a file; or "
        "embedded, the segmenter of metricbody-embedded, which needs no further weights",
    )
    score: Share = Field(0.45, description="least score of a detected person; 0.3 finds more")
    most: int = Field(20, ge=1, le=1000, description="largest number of people, best first")
    floor: Literal["feet", "feet-and-border", "none"] = Field(
        "feet",
        description="where to ask for the floor: beside the feet; at the photo's lower edge, too, "
        "which finds a table "
        "as well; or not at all",
    )


class Sam2(NetworkBackend, Segmenter):
    """Segmenter: SAM 2.1 (or SAM 3's tracker) with a person detector.

    Both networks are identified by the inputs and outputs of their files. The photo is encoded once
    for all people and the floor. Where the detector sees joints (RTMO), they are returned, and the
    points that prompt the floor lie beside ankles, not beside the lower ends of masks.
    """

    written_for = 1
    Options: ClassVar[type[Options]] = Sam2Options
    options: Sam2Options
    weight_options = ("weights", "detector")

    def build(self, device: str) -> tuple[Sam2Networks, Detector | Segmenter]:
        """Open the encoder, the decoder and the detector."""
        from .detectors import open_detector
        from .sam2_networks import open_sam2

        folder = self.file()
        if not folder.is_dir():
            raise BackendError(
                f"SAM 2 is two files in a folder, and {folder} is one file: name their folder"
            )
        detector: Any
        if self.options.detector == EMBEDDED:
            detector = load_backend(
                "segmenter", _SEGMENTER, device=device, threads=self.options.threads
            )
        else:
            detector = open_detector(self.file(option="detector"), self.options, device)
        return open_sam2(folder, self.options, device, self.options.variant), detector

    def close(self) -> None:
        """Close the networks."""
        if self._network is not None and isinstance(self._network[1], Segmenter):
            self._network[1].close()
        super().close()

    def missing(self) -> tuple[str, ...]:
        """Describe the missing files of encoder, decoder and detector, or the missing plugin of the
        embedded one.
        """
        from .sam2_networks import find_sam2_files

        lack = missing(self.manifest(), self.options.weights)
        if not lack:
            try:
                find_sam2_files(self.file(), self.options.variant)
            except PhysicError as error:
                lack = (str(error),)
        if self.options.detector != EMBEDDED:
            return (*lack, *missing(self.manifest(), self.options.detector))
        try:
            find_backend("segmenter", _SEGMENTER)
        except BackendNotFoundError as error:
            return (*lack, str(error).partition("\n")[0])
        return lack

    def fingerprint(self) -> str:
        """Return the checksums of the weights."""
        detector = self.options.detector
        if detector == EMBEDDED:
            found = find_backend("segmenter", _SEGMENTER).owner
            return f"{fingerprint(self.manifest(), self.options.weights)} {found}"
        return super().fingerprint()

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, and the floor.

        Raises:
            InputError: it is not a valid photo.
            BackendError: load() was not called, or a network fails.
        """
        from dataclasses import replace

        from physic_networks.people import Detections, mask_nms, people_from_masks
        from physic_networks.pictures import resize_map

        from .sam2_floor import floor_mask

        networks, detector = self.network
        size = (image.shape[0], image.shape[1])
        seen = detector.infer(image) if isinstance(detector, Segmenter) else None
        if seen is not None:
            found = Detections(seen.boxes, seen.scores, seen.keypoints)
        else:
            found = detector.infer(image, self.options.score, _OVERLAP)
        found = found[found.boxes[:, 3] - found.boxes[:, 1] >= _LEAST_HEIGHT_PX][
            : self.options.most
        ]
        border = self.options.floor == "feet-and-border"
        photo = networks.encode(image) if len(found) or border else None
        logits: FloatArray = np.zeros((0, 1, 1), np.float32)
        if photo is not None and len(found):
            three, fits = networks.masks_from_boxes(photo, found.boxes)
            logits = three[np.arange(len(three)), fits.argmax(axis=1)]
            rows = mask_nms(logits > 0, found.scores)
            found, logits = found[rows], logits[rows]
        people = people_from_masks(
            (resize_map(grid, *size) for grid in logits),
            found.boxes,
            found.scores,
            size=size,
            keypoints=found.keypoints,
        )
        if photo is not None and self.options.floor != "none":
            people = replace(
                people, floor=floor_mask(networks, photo, people, with_lower_edge=border)
            )
        if seen is None:
            return people
        return _with_rest(people, seen, with_floor=self.options.floor != "none")


def _with_rest(people: People, seen: People, *, with_floor: bool) -> People:
    """Return the people with the floor, surfaces, unposed people and carriers that the
    embedded segmenter saw.
    """
    from dataclasses import replace

    anybody: BoolArray = np.asarray(people.masks.any(axis=0))
    floors = (
        [floor for floor in (people.floor, seen.floor) if floor is not None] if with_floor else []
    )
    unposed = None if seen.unposed_mask is None else seen.unposed_mask & ~anybody
    blocked = anybody if unposed is None else anybody | unposed
    return replace(
        people,
        floor=np.asarray(np.logical_or.reduce(floors)) & ~blocked if floors else None,
        surfaces=seen.surfaces,
        unposed=seen.unposed,
        unposed_mask=unposed,
        carriers=seen.carriers,
    )
