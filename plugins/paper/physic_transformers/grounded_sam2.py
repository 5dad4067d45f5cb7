"""Segment people and floor from text: GroundingDINO detects boxes, SAM 2.1 segments them.

The paper's segmenter.

The defaults are those of PhySIC's release: its prompts, thresholds and models.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.interfaces import Segmenter, Share
from physic_networks.networks import WEIGHTS_HELP, picture_tensor, to_numpy
from physic_networks.people import clip_boxes, sigmoid, xyxy_from_cxcywh
from physic_networks.pictures import IMAGENET_MEAN, IMAGENET_STD, resize_image
from physic_transformers.models import (
    ModelOptions,
    ModelSpec,
    PretrainedBackend,
    size_from_edges,
)
from physic_transformers.sam_masks import (
    best_rows,
    people_from_sam,
    people_of_prompt,
    union_of_masks,
)

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, People, PeoplePrompt, UInt8Array

_SHORT = 800  # px, as GroundingDINO was trained
_LONG = 1333  # px
_BOXES_PER_CALL = 16  # boxes a call of the mask decoder


class GroundedSam2Options(ModelOptions):
    """Settings of :class:`GroundedSam2`."""

    detector: str = Field(
        default="grounding-dino-base-hf", description=f"GroundingDINO: {WEIGHTS_HELP}."
    )
    masks: str = Field(
        default="sam2.1-hiera-large-hf", description=f"SAM 2 or 2.1: {WEIGHTS_HELP}."
    )
    people_words: str = Field(
        default="person.", min_length=1, description="Text prompt for people, ending in a dot."
    )
    floor_words: str = Field(
        default="ground, floor, carpet.",
        description="Text prompt for the floor; everything detected is floor. Empty: no search.",
    )
    box_threshold: Share = Field(
        default=0.3, description="Minimum score of a candidate box; 0.25-0.4 works."
    )
    text_threshold: Share = Field(
        default=0.25,
        description="Minimum score of a box for one word of the prompt.",
    )
    person_score: Share = Field(
        default=0.45,
        description="Minimum score of a person; 0.3 finds more, and some furniture.",
    )
    max_people: int = Field(
        default=20, ge=1, le=1000, description="Largest number of people, best first."
    )
    same_person: Share = Field(
        default=0.8, description="Masks with an IoU above this are one person."
    )


class GroundedSam2(PretrainedBackend, Segmenter):
    """Segmenter: GroundingDINO and SAM 2.1, with the prompts and thresholds of the paper's release.

    Points and boxes of the user's are prompts of SAM 2.1; the people of GroundingDINO are then
    skipped.
    """

    written_for = 1
    Options = GroundedSam2Options
    options: GroundedSam2Options
    gpu_gigabytes = MappingProxyType({"float32": 3.6, "float16": 1.8, "bfloat16": 1.8})
    takes_prompt = True
    specs = (
        ModelSpec(
            "detector",
            "GroundingDinoForObjectDetection",
            ("grounding-dino",),
            needs_tokenizer=True,
            samples_grids=True,
        ),
        # The published SAM 2 repositories hold the model for videos, of which this is a spec.
        ModelSpec("masks", "Sam2Model", ("sam2", "sam2_video")),
    )

    def infer(self, image: UInt8Array, prompt: PeoplePrompt | None = None) -> People:
        """Segment the people of an image (H, W, 3), best score first, and the floor.

        With a prompt, exactly the chosen people are segmented, in the order of the prompts.

        Raises:
            InputError: it is not a valid photo.
            NoPersonError: no pixel of a person is found for a prompt.
            BackendError: ``load`` was not called.
        """

        options = self.options
        size = (image.shape[0], image.shape[1])
        pixels = detector_pixels(image, self.device)
        if prompt is None:
            boxes, scores = self._boxes(pixels, options.people_words, options.person_score, size)
            points: FloatArray = np.zeros((0, 2))
        else:
            boxes = np.array(prompt.boxes).reshape(-1, 4)
            points = np.array(prompt.points).reshape(-1, 2)
        floor_boxes: FloatArray = np.zeros((0, 4))
        if options.floor_words:
            floor_boxes, _ = self._boxes(pixels, options.floor_words, options.box_threshold, size)
        logits = self._masks(image, np.concatenate([boxes, floor_boxes]), points)
        people = len(points) + len(boxes)
        floor = union_of_masks(logits[people:], size) if options.floor_words else None
        if prompt is not None:
            return people_of_prompt(logits[:people], prompt, floor, size)
        return people_from_sam(
            logits[:people], boxes, scores, floor, size, same=options.same_person
        )

    def _boxes(
        self, pixels: Any, words: str, threshold: float, size: tuple[int, int]
    ) -> tuple[FloatArray, FloatArray]:
        """Detect boxes (N, 4) px with scores (N,) for a text prompt."""

        network = self.model("detector")
        options = self.options
        text = network.tokenizer(
            format_prompt(words), return_tensors="np", return_token_type_ids=True
        )
        out = network.run(
            pixel_values=pixels,
            pixel_mask=np.ones((1, *pixels.shape[2:]), np.int64),
            **{
                name: np.asarray(text[name], np.int64)
                for name in ("input_ids", "token_type_ids", "attention_mask")
            },
        )
        threshold = max(threshold, options.box_threshold)
        shares, scores, tokens = decode_text_boxes(
            to_numpy(out.logits)[0], to_numpy(out.pred_boxes)[0], threshold, options.text_threshold
        )
        height, width = size
        boxes, inside = clip_boxes(shares * np.array([width, height, width, height]), height, width)
        rows = [i for i in np.flatnonzero(inside) if tokens[i]][: options.max_people]
        return boxes[rows], scores[rows]

    def _masks(self, image: UInt8Array, boxes: FloatArray, points: FloatArray) -> FloatArray:
        """Predict the mask logits (N, h, w) of points (P, 2) px and then of boxes (N - P, 4) px."""

        network = self.model("masks")
        side = int(network.config.prompt_encoder_config.image_size)
        grid = 4 * side // int(network.config.prompt_encoder_config.patch_size)
        if not len(boxes) and not len(points):
            return np.zeros((0, grid, grid), np.float32)
        small = resize_image(image, side, side, "bilinear-antialias")
        pixels = picture_tensor(small, IMAGENET_MEAN, IMAGENET_STD, device=self.device)
        embeddings = network.run("get_image_embeddings", pixel_values=pixels)
        height, width = image.shape[:2]
        scale = side / np.array([width, height])
        masks = []
        if len(points):
            marks = {
                "input_points": points[None, :, None] * scale,
                "input_labels": np.ones((1, len(points), 1)),
            }
            masks.append(self._decode(network, embeddings, **marks))
        prompts = boxes * np.tile(scale, 2)
        for i in range(0, len(prompts), _BOXES_PER_CALL):
            masks.append(
                self._decode(
                    network, embeddings, input_boxes=prompts[None, i : i + _BOXES_PER_CALL]
                )
            )
        return np.concatenate(masks)

    def _decode(self, network: Any, embeddings: Any, **prompts: FloatArray) -> FloatArray:
        """Run the mask decoder on points or boxes, px of the network's picture."""
        inputs = {
            name: value.astype(np.int64 if name == "input_labels" else np.float32)
            for name, value in prompts.items()
        }
        out = network.run(**inputs, image_embeddings=embeddings, multimask_output=False)
        return to_numpy(out.pred_masks)[0, :, 0]


def format_prompt(words: str) -> str:
    """Format a text as in the training of GroundingDINO: lower case, with a full stop."""
    text = words.strip().lower()
    return text if text.endswith(".") else f"{text}."


def decode_text_boxes(
    logits: FloatArray, boxes: FloatArray, box_threshold: float, text_threshold: float
) -> tuple[FloatArray, FloatArray, list[list[int]]]:
    """Decode GroundingDINO's queries, best score first.

    Args:
        logits: (Q, T), how well each query fits each token, of which the first begins the text and
            is not a word.
        boxes: (Q, 4) centre x, centre y, width, height, shares of the photo.
        box_threshold: of the best token's score.
        text_threshold: of the score of reported tokens.

    Returns:
        Boxes (N, 4) x0 y0 x1 y1, shares of the photo's width and height; scores (N,) in [0, 1], of
        the token that fits best; and for each box, places in the text of the tokens that fit.
    """

    chance = sigmoid(np.asarray(logits, np.float64))
    scores = chance.max(axis=1)
    rows = best_rows(scores, box_threshold, len(scores))
    named: BoolArray = chance[rows] > text_threshold
    named[:, [0, -1]] = False
    tokens = [np.flatnonzero(row).tolist() for row in named]
    return xyxy_from_cxcywh(boxes[rows].astype(np.float64)), scores[rows], tokens


def detector_pixels(image: UInt8Array, device: str = "cpu") -> Any:
    """Return the input of GroundingDINO, a tensor (1, 3, h, w)."""
    height, width = size_from_edges(image.shape[0], image.shape[1], _SHORT, _LONG)
    small = resize_image(image, height, width, "bilinear-antialias")
    return picture_tensor(small, IMAGENET_MEAN, IMAGENET_STD, device=device)
