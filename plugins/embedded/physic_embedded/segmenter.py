"""Segment people, floor and surfaces: YOLOX and BlazePose detect people, MobileSAM segments them,
DeepLab labels.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import compress
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from physic_core.backends.people import boxes_from_masks
from physic_core.errors import NoPersonError
from physic_core.interfaces import Options, Segmenter
from physic_core.types import NOT_CHOSEN, People
from physic_embedded.keypoint_detector import keypoints_from_poses
from physic_embedded.networks.ade20k import label_surfaces
from physic_embedded.networks.mobile_sam import embed_image
from physic_embedded.networks.sessions import PackagedBackend, Products, Threads
from physic_embedded.segmentation.floor_mask import add_labelled_floor, floor_mask
from physic_embedded.segmentation.hidden_hips import lower_confidence_of_hidden_hips
from physic_embedded.segmentation.people import (
    LEAST_HEIGHT_PX,
    LOW,
    detect_poses,
    poses_of_same_person,
    unposed_person,
)
from physic_embedded.segmentation.people_in_pictures import halve_unlikely_people
from physic_embedded.segmentation.person_masks import person_masks, resolve_overlaps
from physic_embedded.segmentation.prompted_people import DetectedPeople, choose_poses
from physic_embedded.segmentation.unposed import count_heads, segment_unposed

if TYPE_CHECKING:
    from physic_core.types import BoolArray, PeoplePrompt, SurfaceLabels, UInt8Array, UnposedPerson
    from physic_embedded.networks.mobile_sam import ImageEmbedding
    from physic_embedded.networks.pose import Pose
    from physic_embedded.segmentation.people import DetectedPose

NETWORKS = (
    "yolox_nano",
    "pose_detection",
    "pose_landmark_heavy",
    "mobilesam_encoder",
    "mobilesam_decoder",
    "deeplabv3_mnv2_ade20k",
)

_PART = 0.75
"""Share of the pixels of a person whom the detector did not find, and whose pose is that of
another one, above which the person is a part of others. A carried person has all pixels in the mask
of who carries them, but another pose.
"""
_BOX_SCORE = 0.4  # of a person by YOLOX; 0.1 less if a pose fits the box well


class EmbeddedSegmenterOptions(Options):
    """Settings of :class:`EmbeddedSegmenter`."""

    tile_fractions: tuple[Annotated[float, Field(ge=0.05, le=1)], ...] = Field(
        default=(0.6,),
        max_length=8,
        description="Sides of the tiles that are searched beside the whole photo, over its long "
        "side; add 0.4 and 0.18 to find more of a crowd, slowly; leave empty for one person in the "
        "middle.",
    )
    max_people: int = Field(
        default=20, ge=1, le=1000, description="Largest number of people, best first."
    )
    floor: bool = Field(
        default=True, description="Look for the floor beside the feet, and among the surfaces."
    )
    surfaces: bool = Field(
        default=True, description="Label floor, walls, seats and other surfaces."
    )
    products: Products = Field(
        default="float32",
        description="Arithmetic of the mask network's matrix products; auto is int8 on the CPU "
        "and float32 elsewhere. "
        "With int8, one level of one pixel can move the edge of a mask, and by it the focal "
        "length.",
    )
    threads: Threads = 2


class EmbeddedSegmenter(PackagedBackend, Segmenter):
    """Segmenter: the single-person BlazePose detects people, MobileSAM predicts the masks of people
    and floor.

    Also returns the joints (``People.keypoints``, "blazepose33", with world landmarks) and the
    surfaces that DeepLabv3 labels (``People.surfaces``).
    """

    written_for = 1
    weights_license = "Apache-2.0 (YOLOX, MediaPipe BlazePose, MobileSAM, DeepLabv3), MIT (TinyViT)"
    Options = EmbeddedSegmenterOptions
    options: EmbeddedSegmenterOptions
    takes_prompt = True
    networks = NETWORKS

    def infer(self, image: UInt8Array, prompt: PeoplePrompt | None = None) -> People:
        """Segment the people and the floor of an image (H, W, 3); people are sorted by score.

        With a prompt, exactly the chosen people are segmented, in the order of the prompts.

        Raises:
            NoPersonError: no pose is found for a prompt, or two prompts hit the same person.
        """
        networks = self.network
        options = self.options
        found, unposed, left_out, carriers = detect_poses(
            networks["yolox_nano"],
            networks["pose_detection"],
            networks["pose_landmark_heavy"],
            image,
            box_score=_BOX_SCORE,
            fractions=options.tile_fractions,
            max_people=options.max_people,
        )
        if not found and not unposed and prompt is None:
            return replace(self._empty_result(image), notes=_left_out_note(left_out))
        embedding = embed_image(networks["mobilesam_encoder"], image)
        masks = self._masks(embedding, [person.pose for person in found])
        others: list[DetectedPose] = []
        if prompt is not None:
            detected = DetectedPeople(
                image,
                networks["pose_landmark_heavy"],
                networks["mobilesam_decoder"],
                embedding,
                found,
                masks,
            )
            chosen, masks = self._chosen(detected, prompt)
            others = [one for one in found if not poses_of_same_person(one.pose, chosen)]
            found, unposed = chosen, []
        else:
            found, masks, low = self._omit_low_masks(found, masks)
            unposed += low
        poses = [person.pose for person in found]
        people = np.asarray(masks.any(axis=0))
        surfaces, framed = self._surfaces(image, people)
        reported, unposed_mask = segment_unposed(
            networks["mobilesam_decoder"], embedding, unposed, poses, people, surfaces
        )
        floor = self._floor_mask(embedding, poses, people | unposed_mask, surfaces)
        seen = self._people(found, masks, floor, surfaces, image)
        result = replace(
            seen,
            heads=count_heads([one for one in unposed if one.is_missing], poses, masks),
            unposed=reported
            + tuple(unposed_person(one.extent, one.score, NOT_CHOSEN) for one in others),
            unposed_mask=unposed_mask,
            carriers=carriers,
            notes=_left_out_note(left_out),
        )
        return halve_unlikely_people(result, framed) if prompt is None else result

    def _empty_result(self, image: UInt8Array) -> People:
        """Return the surfaces of an image without people."""
        people = np.zeros(image.shape[:2], bool)
        surfaces, _ = self._surfaces(image, people)
        floor = add_labelled_floor(people, surfaces, people) if self.options.floor else None
        return self._people([], np.zeros((0, *people.shape), bool), floor, surfaces, image)

    def _chosen(
        self, detected: DetectedPeople, prompt: PeoplePrompt
    ) -> tuple[list[DetectedPose], BoolArray]:
        """Return the people of a prompt, and their masks (N, H, W)."""
        found = choose_poses(detected, prompt)
        masks = self._masks(detected.embedding, [person.pose for person in found])
        sure = np.array([any(one.pose is other.pose for other in detected.poses) for one in found])
        others = list(compress(found, sure))
        repeats = np.array([bool(poses_of_same_person(one.pose, others)) for one in found]) & ~sure
        if repeats.any():
            alone = self._masks(detected.embedding, [one.pose for one in others])
            masks = _reassign_parts(masks, sure, repeats, alone)
        return found, _with_given_masks(masks, prompt)

    def _floor_mask(
        self,
        embedding: ImageEmbedding,
        poses: list[Pose],
        people: BoolArray,
        surfaces: SurfaceLabels | None,
    ) -> BoolArray | None:
        """Return the floor (H, W) outside the people, or None if ``floor`` is not set."""
        if not self.options.floor:
            return None
        floor = np.zeros_like(people)
        if poses:
            floor = floor_mask(self.network["mobilesam_decoder"], embedding, poses, people)
        return add_labelled_floor(floor, surfaces, people)

    def _surfaces(
        self, image: UInt8Array, people: BoolArray
    ) -> tuple[SurfaceLabels | None, BoolArray]:
        """Return the semantic labels outside of the people (H, W), if ``surfaces`` is set, and the
        pixels of paintings and mirrors.
        """
        if not self.options.surfaces:
            return None, np.zeros_like(people)
        return label_surfaces(self.network["deeplabv3_mnv2_ade20k"], image, people)

    def _masks(self, embedding: ImageEmbedding, poses: list[Pose]) -> BoolArray:
        """Return the masks (N, H, W) of people with poses."""
        alone = person_masks(self.network["mobilesam_decoder"], embedding, poses)
        return resolve_overlaps(alone, embedding)

    def _omit_low_masks(
        self, detections: list[DetectedPose], masks: BoolArray
    ) -> tuple[list[DetectedPose], BoolArray, list[UnposedPerson]]:
        """Omit people whose mask is low, and return them as boxes without a pose."""
        edges = boxes_from_masks(masks)
        tall = edges[:, 3] - edges[:, 1] >= LEAST_HEIGHT_PX
        low = [unposed_person(one.extent, one.score, LOW) for one in compress(detections, ~tall)]
        return list(compress(detections, tall)), masks[tall], low

    def _people(
        self,
        detections: list[DetectedPose],
        masks: BoolArray,
        floor: BoolArray | None,
        surfaces: SurfaceLabels | None,
        image: UInt8Array,
    ) -> People:
        """Return the people with their poses."""
        keypoints = keypoints_from_poses([person.pose for person in detections], *image.shape[:2])
        return People(
            masks=masks,
            boxes=boxes_from_masks(masks).astype(np.float32),
            scores=np.array([person.score for person in detections], np.float32),
            floor=floor,
            keypoints=lower_confidence_of_hidden_hips(keypoints, masks),
            surfaces=surfaces,
        )


def _left_out_note(names: list[str]) -> tuple[str, ...]:
    """Return a note about the animals and boards that look like people."""
    if not names:
        return ()
    return (f"left out objects that look somewhat like a person: {', '.join(names)}",)


def _reassign_parts(
    masks: BoolArray, is_sure: BoolArray, repeats: BoolArray, separate_masks: BoolArray
) -> BoolArray:
    """Return masks (N, H, W) in which the people who are ``is_sure`` (N,) have the pixels that
    parts of them took: ``repeats`` (N,) of their poses, most of whose mask is in the
    masks (S, H, W) of the sure people alone.
    """
    changed = masks.copy()
    theirs = np.asarray(separate_masks.any(0))
    for i in np.flatnonzero(repeats):
        taken = masks[i] & theirs
        if taken.sum() > _PART * masks[i].sum():
            changed[i] &= ~theirs
            changed[is_sure] |= separate_masks & taken
    return changed


def _with_given_masks(masks: BoolArray, prompt: PeoplePrompt) -> BoolArray:
    """Replace the masks (N, H, W) of the last people by the given ones, which take pixels of the
    others.

    Raises:
        NoPersonError: no pixel of a person is left.
    """
    if prompt.masks is not None:
        masks = masks & ~prompt.masks.any(axis=0)
        masks[len(masks) - len(prompt.masks) :] = prompt.masks
    for i, mask in enumerate(masks):
        if not mask.any():
            raise NoPersonError(
                f"the other people hide every pixel of the person at {prompt.describe(i)}: leave "
                f"it out, or give masks"
            )
    return masks
