"""Where these networks are easily fed or read wrongly: one test per mistake."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core.interfaces import INTERFACES
from physic_core.types import Hints, Intrinsics
from physic_testing import violations
from physic_transformers.depth_pro import DepthPro
from physic_transformers.grounded_sam2 import (
    GroundedSam2,
    GroundedSam2Options,
)
from physic_transformers.sam3 import Sam3

LOW = {"box_threshold": 0.0, "text_threshold": 0.0, "person_score": 0.0}
"""Options with which a network of random weights finds something."""

WIDE = np.random.default_rng(0).integers(0, 256, (60, 100, 3), np.uint8)


class Recorded:
    """A network that keeps what it was asked and answers the next of some answers, or the only
    one.
    """

    def __init__(self, config, *answers, tokenizer=None):
        self.config = config
        self.tokenizer = tokenizer
        self.output_kind = list(answers)
        self.asked = []

    def run(self, method="", /, **inputs):
        self.asked.append(
            (method, {k: np.asarray(v) if torch.is_tensor(v) else v for k, v in inputs.items()})
        )
        return self.output_kind.pop(0) if len(self.output_kind) > 1 else self.output_kind[0]


def given(backend, **networks):
    backend._network = networks
    return backend


def tensors(**arrays):
    return SimpleNamespace(**{name: torch.as_tensor(value) for name, value in arrays.items()})


class TestWithoutTorchvision:
    """The library's image processors want torchvision, which cannot always be had."""

    @pytest.fixture(autouse=True)
    def _none_of_it(self, monkeypatch):
        import transformers

        def refuse(*_, **__):
            raise AssertionError("a processor of the library was asked for")

        monkeypatch.setitem(sys.modules, "torchvision", None)
        for name in ("AutoImageProcessor", "AutoProcessor"):
            monkeypatch.setattr(getattr(transformers, name), "from_pretrained", refuse)

    @pytest.mark.parametrize("dtype", ["float32", "bfloat16"])
    @pytest.mark.parametrize(
        ("kind", "networks", "options"),
        [
            (GroundedSam2, {"detector": "grounding_dino", "masks": "sam2"}, LOW),
            (Sam3, {"weights": "sam3"}, {"person_score": 0}),
            (DepthPro, {"weights": "depth_pro"}, {"farthest": 1e6}),
        ],
    )
    def test_the_real_classes_load_and_infer(self, stored, kind, networks, options, dtype, capfd):
        backend = stored(kind, networks, **options, precision=dtype)
        backend.load()
        hints = Hints(intrinsics=Intrinsics.from_focal(90.0, 100, 60))
        answer = backend.infer(WIDE, *[hints] * (kind is DepthPro))
        backend.close()
        assert violations(INTERFACES[kind.interface], answer, height=60, width=100) == []
        assert capfd.readouterr() == ("", "")


class TestGroundedSam2:
    MASKS = SimpleNamespace(prompt_encoder_config=SimpleNamespace(image_size=1024, patch_size=16))

    def words(self, text, **_):
        self.texts = [*getattr(self, "texts", []), text]
        return {
            name: np.ones((1, 4), np.int32)
            for name in ("input_ids", "token_type_ids", "attention_mask")
        }

    def found(self, *rows):
        """Scores and boxes (centre, size) of queries."""
        logits = np.full((1, len(rows), 256), -9.0)
        logits[0, :, 1] = [np.log(score / (1 - score)) for score, _ in rows]
        return tensors(logits=logits, pred_boxes=[[box for _, box in rows]])

    def run(self, people, floor, masks, **options):
        detector = Recorded(None, people, floor, None, tokenizer=self.words)
        sam = Recorded(self.MASKS, "embeddings", *masks, None)
        backend = given(GroundedSam2(GroundedSam2Options(**options)), detector=detector, masks=sam)
        return backend.infer(WIDE), sam

    def inside(self, *boxes):
        """Mask logits on the grid of 256, of boxes in px of the grid."""
        logits = np.full((1, len(boxes), 1, 256, 256), -5.0, np.float32)
        for mask, (x0, y0, x1, y1) in zip(logits[0, :, 0], boxes, strict=True):
            mask[y0:y1, x0:x1] = 5.0
        return tensors(pred_masks=logits)

    def test_people_are_surer_than_the_floor_and_prompts_are_pixels_of_the_square(self):
        people = self.found((0.9, [0.25, 0.5, 0.3, 0.8]), (0.4, [0.75, 0.5, 0.2, 0.8]))
        floor = self.found(
            (0.35, [0.5, 0.9, 1.0, 0.2]), (0.5, [0.5, 0.75, 0.2, 0.5]), (0.2, [0.1, 0.1, 0.1, 0.1])
        )
        masks = self.inside((26, 26, 102, 230), (102, 128, 154, 256), (0, 205, 256, 256))
        answer, sam = self.run(people, floor, [masks])
        assert self.texts == ["person.", "ground, floor, carpet."]
        prompts = sam.asked[1][1]["input_boxes"]
        np.testing.assert_allclose(
            prompts[0, 0], [0.1 * 1024, 0.1 * 1024, 0.4 * 1024, 0.9 * 1024], atol=0.01
        )
        assert prompts.shape == (1, 3, 4), "who scores 0.4 is nobody, what scores 0.2 is not floor"
        assert len(answer) == 1
        np.testing.assert_allclose(answer.boxes[0], [10, 6, 40, 54], atol=1)
        assert answer.floor[58, 90], "the one"
        assert answer.floor[35, 50], "and the other: the floor is all of them"
        assert not (answer.floor & answer.masks.any(0)).any()
