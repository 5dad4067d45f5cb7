"""Segment people, floor and surfaces: YOLOX and BlazePose detect people, MobileSAM segments them, DeepLab labels."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.people import boxes_from_masks
from physic_core.interfaces import Options, Segmenter
from physic_core.types import People
from physic_embedded.keypoint_detector import keypoints_from_poses
from physic_embedded.networks.ade20k import label_surfaces
from physic_embedded.networks.mobile_sam import encode_image
from physic_embedded.networks.sessions import PackagedNetworks
from physic_embedded.segmentation.floor_mask import add_labelled_floor, floor_mask
from physic_embedded.segmentation.people import SearchSettings, detect_poses
from physic_embedded.segmentation.person_masks import person_mask, resolve_overlaps

if TYPE_CHECKING:
    from physic_core.types import BoolArray, UInt8Array
    from physic_embedded.networks.pose import Pose

__all__ = ["EmbeddedSegmenter", "EmbeddedSegmenterOptions"]

NETWORKS = (
    "yolox_nano",
    "pose_detection",
    "pose_landmark_heavy",
    "mobilesam_encoder",
    "mobilesam_decoder",
    "deeplabv3_mnv2_ade20k",
)


class EmbeddedSegmenterOptions(Options):
    """Settings of :class:`EmbeddedSegmenter`."""

    box_score: float = Field(
        default=0.4, ge=0, le=1, description="Lowest score of a person's box by YOLOX; 0.1 more is needed in a tile."
    )
    sure_score: float = Field(
        default=0.75,
        ge=0,
        le=1,
        description="BlazePose score from which a candidate without a box is a person; 0.6 finds chairs too.",
    )
    weak_score: float = Field(
        default=0.3,
        ge=0,
        le=1,
        description="Detector score from which a candidate is looked at, and kept if two looks agree; 1 = never.",
    )
    tile_fractions: tuple[float, ...] = Field(
        default=(0.6, 0.4),
        description="Sides of the tiles that are searched beside the whole photo, over its long side; "
        "add 0.18 to find more of a crowd, slowly; leave empty for one person in the middle.",
    )
    max_people: int = Field(default=20, ge=1, description="At most so many people, best first.")
    min_height_px: float = Field(default=40, ge=0, description="People whose mask is lower than this are left out.")
    floor: bool = Field(default=True, description="Look for the floor beside the feet, and among the surfaces.")
    surfaces: bool = Field(default=True, description="Label floor, walls, seats and other surfaces.")
    threads: int = Field(default=2, ge=0, description="Threads inside one operator; 0 lets onnxruntime choose.")


class EmbeddedSegmenter(Segmenter):
    """Segmenter: the single-person BlazePose detects people, MobileSAM predicts the masks of people and floor.

    Also returns the joints (``People.keypoints``, "blazepose33", with world landmarks) and the surfaces that DeepLabv3
    labels (``People.surfaces``).
    """

    Options: ClassVar[type[Options]] = EmbeddedSegmenterOptions
    options: EmbeddedSegmenterOptions

    def __init__(self, options: EmbeddedSegmenterOptions | None = None) -> None:
        super().__init__(options)
        self._networks = PackagedNetworks(*NETWORKS)

    def load(self, device: str = "cpu") -> None:
        """Open the networks.

        Raises:
            DeviceError: the device is not there.
        """
        self._networks.open(device, self.options.threads)

    def close(self) -> None:
        """Close the networks."""
        self._networks.close()

    def infer(self, image: UInt8Array) -> People:
        """Segment the people and the floor of an image (H, W, 3); people are sorted by score."""
        networks, options = self._networks, self.options
        found = detect_poses(
            networks["yolox_nano"],
            networks["pose_detection"],
            networks["pose_landmark_heavy"],
            image,
            SearchSettings(
                box_score=options.box_score,
                sure=options.sure_score,
                weak=options.weak_score,
                fractions=options.tile_fractions,
                max_people=options.max_people,
            ),
        )
        poses = [person.pose for person in found]
        masks, floor = self._masks(image, poses)
        surfaces = None
        if options.surfaces:
            anybody = np.asarray(masks.any(axis=0))
            surfaces = label_surfaces(networks["deeplabv3_mnv2_ade20k"], image, anybody)
            floor = None if floor is None else add_labelled_floor(floor, surfaces, anybody)
        boxes = boxes_from_masks(masks).astype(np.float32)
        tall = boxes[:, 3] - boxes[:, 1] >= max(options.min_height_px, 1.0)
        return People(
            masks=masks[tall],
            boxes=boxes[tall],
            scores=np.array([person.score for person in found], np.float32)[tall],
            floor=floor,
            keypoints=keypoints_from_poses([p for p, t in zip(poses, tall, strict=True) if t], *image.shape[:2]),
            surfaces=surfaces,
        )

    def _masks(self, image: UInt8Array, poses: list[Pose]) -> tuple[BoolArray, BoolArray | None]:
        """Return the masks (N, H, W) of the people and, if ``floor`` is set, the floor."""
        if not poses:
            nothing = np.zeros(image.shape[:2], bool)
            return np.zeros((0, *nothing.shape), bool), nothing if self.options.floor else None
        embedding = encode_image(self._networks["mobilesam_encoder"], image)
        decoder = self._networks["mobilesam_decoder"]
        alone = [person_mask(decoder, embedding, p, [q for q in poses if q is not p]) for p in poses]
        masks = resolve_overlaps(alone, embedding)
        floor = floor_mask(decoder, embedding, poses, np.logical_or.reduce(masks)) if self.options.floor else None
        return masks, floor
