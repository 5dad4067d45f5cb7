"""Segment people with SAM 2 in the boxes of a detector, and the floor at their feet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core import discover, load_backend
from physic_core.errors import BackendError, BackendNotFoundError, PhysicError
from physic_core.interfaces import Options, Segmenter, Share
from physic_core.weights import fingerprint, locate, missing

from .options import OnnxOptions

if TYPE_CHECKING:
    from physic_core.adapters.detections import Detections
    from physic_core.types import BoolArray, FloatArray, People, UInt8Array

    from .detectors import Detector
    from .sam2_networks import EncodedImage, Sam2Networks

MANIFEST = Path(__file__).parent / "weights"
EMBEDDED = "embedded"
"""Value of the option ``detector``: boxes, joints and surfaces of the segmenter in the wheel of physic-embedded."""
_SEGMENTER = "physic-embedded:embedded"


class Sam2Options(OnnxOptions):
    """Settings of Sam2."""

    weights: str = Field(
        "sam2.1-hiera-tiny",
        description="a name of `physic weights list`, or a folder of your own with an encoder and a decoder; "
        "small, base-plus and large are better at hair and fingers, and slower",
    )
    variant: str = Field("", description="of the encoder's file, such as fp16 or quantized; empty for the plain one")
    detector: str = Field(
        "rtdetr-r50",
        description="what finds people: YOLOX, RT-DETR, D-FINE or RTMO, a name of `physic weights list` or a file; or "
        "embedded, the segmenter of physic-embedded, which needs no further weights",
    )
    score: Share = Field(0.45, description="from which a detected person is believed; 0.3 finds more")
    overlap: float = Field(
        0.65, gt=0, le=1, description="boxes that share more are one person's; 0.45 where one is found twice"
    )
    most: int = Field(20, ge=1, le=1000, description="people at most, best first")
    smallest_px: float = Field(24, ge=0, le=100_000, description="people whose box is less high are skipped, px")
    floor: Literal["feet", "feet-and-border", "none"] = Field(
        "feet",
        description="where to ask for the floor: beside the feet; at the photo's lower edge, too, which finds a table "
        "as well; or not at all",
    )


class Sam2(Segmenter):
    """Segmenter: SAM 2.1 (or SAM 3's tracker) with a person detector.

    Both networks are identified by the inputs and outputs of their files. The photo is encoded once for all people and
    the floor. Where the detector sees joints (RTMO), they are returned, and the points that prompt the
    floor lie beside ankles, not beside the lower ends of masks.
    """

    Options: ClassVar[type[Options]] = Sam2Options
    options: Sam2Options

    def __init__(self, options: Sam2Options | None = None) -> None:
        super().__init__(options)
        self._networks: Sam2Networks | None = None
        self._detector: Detector | None = None
        self._segmenter: Segmenter | None = None

    def load(self, device: str = "cpu") -> None:
        """Open the encoder, the decoder and the detector.

        Raises:
            WeightsMissingError: files are not here; the message says how to get them.
            BackendError: a file is not what it should be.
            DeviceError: the device is not there.
        """
        from .detectors import open_detector
        from .sam2_networks import open_sam2

        if self._networks is not None:
            return
        folder = locate(MANIFEST, self.options.weights)
        if not folder.is_dir():
            raise BackendError(f"SAM 2 is two files in a folder, and {folder} is one file: name their folder")
        if self.options.detector == EMBEDDED:
            found = load_backend("segmenter", _SEGMENTER, device=device, threads=self.options.threads)
            assert isinstance(found, Segmenter)
            self._segmenter = found
        else:
            self._detector = open_detector(locate(MANIFEST, self.options.detector), self.options, device)
        self._networks = open_sam2(folder, self.options, device, self.options.variant)

    def close(self) -> None:
        """Close the networks."""
        if self._segmenter is not None:
            self._segmenter.close()
        self._networks = self._detector = self._segmenter = None

    def missing(self) -> tuple[str, ...]:
        """Describe the missing files of encoder, decoder and detector."""
        lack = missing(MANIFEST, self.options.weights)
        return (*(lack or self._not_in_folder()), *self._missing_detector())

    def fingerprint(self) -> str:
        """Return the checksums of the weights."""
        detector = self.options.detector
        if detector == EMBEDDED:
            found = discover().get("segmenter", _SEGMENTER).origin
            return f"{fingerprint(MANIFEST, self.options.weights)} {found}"
        return f"{fingerprint(MANIFEST, self.options.weights)} {fingerprint(MANIFEST, detector)}"

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, and the floor.

        Raises:
            InputError: it is not a valid photo.
            BackendError: load() was not called, or a network fails.
        """
        from dataclasses import replace

        from physic_core.adapters.detections import Detections
        from physic_core.adapters.people import people_from_masks
        from physic_core.adapters.pictures import resize_map

        from .sam2_floor import floor_mask

        if self._networks is None or (self._detector is None and self._segmenter is None):
            raise BackendError("SAM 2 is not loaded: call load() before infer()")
        size = (image.shape[0], image.shape[1])
        seen = None if self._segmenter is None else self._segmenter.infer(image)
        if seen is not None:
            found = Detections(seen.boxes, seen.scores, seen.keypoints)
        elif self._detector is not None:
            found = self._detector.infer(image, self.options.score, self.options.overlap)
        found = found[found.boxes[:, 3] - found.boxes[:, 1] >= self.options.smallest_px][: self.options.most]
        border = self.options.floor == "feet-and-border"
        if not len(found) and not border:
            nobody = people_from_masks([], None, found.scores, size=size, keypoints=found.keypoints)
            return nobody if seen is None else _with_rest(nobody, seen, with_floor=self.options.floor != "none")
        photo = self._networks.encode(image)
        found, logits = self._masks(self._networks, photo, found)
        people = people_from_masks(
            (resize_map(grid, *size) for grid in logits),
            found.boxes,
            found.scores,
            size=size,
            keypoints=found.keypoints,
        )
        if self.options.floor != "none":
            people = replace(people, floor=floor_mask(self._networks, photo, people, border=border))
        return people if seen is None else _with_rest(people, seen, with_floor=self.options.floor != "none")

    def _missing_detector(self) -> tuple[str, ...]:
        """Describe missing files of the detector, or the missing plugin of the embedded one."""
        if self.options.detector != EMBEDDED:
            return missing(MANIFEST, self.options.detector)
        try:
            discover().get("segmenter", _SEGMENTER)
        except BackendNotFoundError as error:
            return (str(error).partition("\n")[0],)
        return ()

    @staticmethod
    def _masks(networks: Sam2Networks, photo: EncodedImage, found: Detections) -> tuple[Detections, FloatArray]:
        """Return the people with distinct masks, and their mask logits (N, h, w)."""

        from physic_core.adapters.people import mask_nms

        if not len(found):
            return found, np.zeros((0, 1, 1), np.float32)
        three, fits = networks.masks_from_boxes(photo, found.boxes)
        logits = three[np.arange(len(three)), fits.argmax(axis=1)]
        rows = mask_nms(logits > 0, found.scores)
        return found[rows], logits[rows]

    def _not_in_folder(self) -> tuple[str, ...]:
        """Describe a missing encoder or decoder in the folder."""
        from .sam2_networks import find_sam2_files

        try:
            find_sam2_files(locate(MANIFEST, self.options.weights), self.options.variant)
        except PhysicError as error:
            return (str(error),)
        return ()


def _with_rest(people: People, seen: People, *, with_floor: bool) -> People:
    """Return the people with the floor, surfaces, unposed people and objects that the embedded segmenter saw."""
    from dataclasses import replace

    anybody: BoolArray = np.asarray(people.masks.any(axis=0))
    floors = [floor for floor in (people.floor, seen.floor) if floor is not None] if with_floor else []
    unposed = None if seen.unposed_mask is None else seen.unposed_mask & ~anybody
    blocked = anybody if unposed is None else anybody | unposed
    return replace(
        people,
        floor=np.asarray(np.logical_or.reduce(floors)) & ~blocked if floors else None,
        surfaces=seen.surfaces,
        unposed=seen.unposed,
        unposed_mask=unposed,
        objects=None if seen.objects is None else seen.objects & ~anybody,
    )
