"""Segment people and floor from text with SAM 3."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.interfaces import Segmenter, Share
from physic_networks.networks import WEIGHTS_HELP, picture_tensor, to_numpy
from physic_networks.people import clip_boxes, sigmoid
from physic_networks.pictures import resize_image, resize_map
from physic_transformers.models import ModelOptions, ModelSpec, PretrainedBackend
from physic_transformers.sam_masks import best_rows, people_from_sam

if TYPE_CHECKING:
    from physic_core.types import BoolArray, People, UInt8Array

_MEAN = _STD = (0.5, 0.5, 0.5)
_TOKENS = 32  # of each text: shorter ones are padded
_FLOOR_SCORE = 0.5  # chance from which a pixel is the floor


class Sam3Options(ModelOptions):
    """Settings of :class:`Sam3`."""

    weights: str = Field(default="sam3-hf", description=f"SAM 3: {WEIGHTS_HELP}.")
    people_words: str = Field(
        default="person", min_length=1, description="What a person is called."
    )
    floor_words: str = Field(
        default="ground, floor, carpet.",
        description="Text prompts for the floor, separated by "
        "commas; everything detected is floor. Empty: no search.",
    )
    person_score: Share = Field(
        default=0.5, description="Minimum score of a person; 0.3 finds more."
    )
    max_people: int = Field(
        default=20, ge=1, le=1000, description="Largest number of people, best first."
    )
    same_person: Share = Field(
        default=0.8, description="Masks with an IoU above this are one person."
    )


class Sam3(PretrainedBackend, Segmenter):
    """Segmenter by SAM 3: person masks from a text prompt for people, floor pixels from a text
    prompt for the floor.

    The photo is encoded once.
    """

    written_for = 1
    Options = Sam3Options
    options: Sam3Options
    gpu_gigabytes = MappingProxyType({"float32": 4.7, "float16": 2.5, "bfloat16": 2.5})
    # The published repository holds the model for videos, of which this is a spec.
    specs = (ModelSpec("weights", "Sam3Model", ("sam3", "sam3_video"), needs_tokenizer=True),)

    def infer(self, image: UInt8Array) -> People:
        """Segment the people of an image (H, W, 3), best score first, and the floor.

        Raises:
            InputError: it is not a valid photo.
            BackendError: ``load`` was not called.
        """

        options = self.options
        size = (image.shape[0], image.shape[1])
        config = self.model().config
        config = getattr(config, "detector_config", None) or config  # of a model for videos
        side = int(config.image_size)
        pixels = picture_tensor(
            resize_image(image, side, side, "bilinear-antialias"), _MEAN, _STD, device=self.device
        )
        features = self.model().run("get_vision_features", pixel_values=pixels)
        floor = self._floor_mask_of_words(features, size)
        out = self._segment_words(features, options.people_words)
        # How well a query fits the text, if there is such a thing in the photo at all.
        scores = sigmoid(to_numpy(out.pred_logits)[0]) * sigmoid(to_numpy(out.presence_logits)[0])
        rows = best_rows(scores, options.person_score, options.max_people)
        height, width = size
        boxes, inside = clip_boxes(
            to_numpy(out.pred_boxes)[0, rows] * np.array([width, height, width, height]),
            height,
            width,
        )
        masks = to_numpy(out.pred_masks)[0, rows]
        return people_from_sam(
            masks[inside],
            boxes[inside],
            scores[rows][inside],
            floor,
            size,
            same=options.same_person,
        )

    def _floor_mask_of_words(self, features: Any, size: tuple[int, int]) -> BoolArray | None:
        """Return the union of the masks of each floor word, because SAM 3 was trained on one short
        noun phrase at a time.
        """

        words = [word for spec in self.options.floor_words.split(",") if (word := spec.strip(" ."))]
        if not words:
            return None
        floor: BoolArray = np.zeros(size, bool)
        for word in words:
            out = self._segment_words(features, word)
            chance = (
                sigmoid(to_numpy(out.semantic_seg)[0, 0])
                * sigmoid(to_numpy(out.presence_logits)[0]).item()
            )
            floor |= resize_map(chance, *size) > _FLOOR_SCORE
        return floor

    def _segment_words(self, features: Any, words: str) -> Any:
        """Run the network on a text and an encoded photo."""

        network = self.model()
        text = network.tokenizer(
            words.strip().lower(),
            return_tensors="np",
            padding="max_length",
            max_length=_TOKENS,
            truncation=True,
        )
        ids = {name: np.asarray(text[name], np.int64) for name in ("input_ids", "attention_mask")}
        return network.run(vision_embeds=features, **ids)
