"""What goes in and what comes out, against transformers' own processors where they run without
torchvision.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physic_core.types import Hints, Intrinsics
from physic_transformers import depth_pro, grounded_sam2

SIZES = [(480, 640), (1080, 1920), (97, 131), (120, 900)]
"""Height and width."""


def photo(height, width):
    """Coarse patches of colour, and fine grain."""
    rng = np.random.default_rng(height * 7 + width)
    coarse = np.kron(
        rng.integers(0, 256, (-(-height // 16), -(-width // 16), 3)), np.ones((16, 16, 1))
    )
    grain = rng.integers(-20, 21, (height, width, 3))
    return np.clip(coarse[:height, :width] + grain, 0, 255).astype(np.uint8)


class TestGroundingDino:
    @pytest.mark.parametrize(("height", "width"), SIZES)
    def test_the_pixels_are_those_of_the_library(self, height, width):
        from transformers import GroundingDinoImageProcessorPil

        image = photo(height, width)
        theirs = GroundingDinoImageProcessorPil()(images=image, return_tensors="np")["pixel_values"]
        ours = grounded_sam2.detector_pixels(image)
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, atol=2e-6)

    def test_boxes_scores_and_words_are_those_of_the_library(self, saved):
        from transformers import AutoTokenizer, GroundingDinoProcessor

        tokenizer = AutoTokenizer.from_pretrained(str(saved("grounding_dino")))
        ids = tokenizer("ground, floor, carpet.", return_tensors="pt")["input_ids"]
        rng = np.random.default_rng(1)
        logits = torch.full((1, 50, 256), -torch.inf)
        logits[..., : ids.shape[1]] = torch.from_numpy(rng.normal(-1.0, 1.5, (1, 50, ids.shape[1])))
        boxes = torch.from_numpy(rng.uniform(0.2, 0.4, (1, 50, 4)))
        (theirs,) = GroundingDinoProcessor.post_process_grounded_object_detection(
            SimpleNamespace(batch_decode=tokenizer.batch_decode),
            SimpleNamespace(logits=logits, pred_boxes=boxes),
            ids,
            threshold=0.3,
            text_threshold=0.25,
            target_sizes=[(480, 640)],
        )
        decoded, scores, tokens = grounded_sam2.decode_text_boxes(
            logits[0].numpy(), boxes[0].numpy(), 0.3, 0.25
        )
        order = np.argsort(-theirs["scores"].numpy(), kind="stable")
        assert len(order) > 10
        np.testing.assert_allclose(scores, theirs["scores"].numpy()[order], rtol=1e-6)
        np.testing.assert_allclose(
            decoded * [640, 480, 640, 480], theirs["boxes"].numpy()[order], rtol=1e-5
        )
        words = [tokenizer.decode(ids[0, of_box]) for of_box in tokens]
        assert words == [theirs["text_labels"][i] for i in order]


class TestDepthPro:
    @pytest.mark.parametrize(("height", "width"), [(1200, 1920), (97, 131)])
    def test_the_pixels_are_normalised_and_resized_without_antialiasing(self, height, width):
        image = photo(height, width)
        normal = (torch.from_numpy(image.transpose(2, 0, 1)[None]) / 255 - 0.5) / 0.5
        theirs = torch.nn.functional.interpolate(
            normal, (768, 768), mode="bilinear", align_corners=False
        )
        np.testing.assert_allclose(depth_pro.preprocess(image, 768), theirs.numpy(), atol=2e-4)

    def test_depth_and_focal_length_follow_the_formulas_of_the_library(self):
        rng = np.random.default_rng(3)
        raw = torch.from_numpy(rng.uniform(0.05, 2.0, (1, 24, 24)).astype(np.float32))
        out = SimpleNamespace(predicted_depth=raw, field_of_view=torch.tensor([52.0]))
        height = 60
        width = 80
        focal = 0.5 * width / torch.tan(0.5 * torch.deg2rad(out.field_of_view))
        inverse = torch.nn.functional.interpolate(
            (raw * width / focal)[:, None], (height, width), mode="bilinear"
        )
        theirs = 1 / torch.clamp(inverse[0, 0], 1e-4, 1e4)
        backend = depth_pro.DepthPro()
        config = SimpleNamespace(patch_size=6, scaled_images_ratios=[0.25, 0.5, 1])
        backend._network = {"weights": SimpleNamespace(config=config, run=lambda **_: out)}
        answer = backend.infer(photo(height, width), Hints())
        np.testing.assert_allclose(answer.depth, theirs.numpy(), rtol=1e-4)
        assert answer.intrinsics.fx == pytest.approx(float(focal), rel=1e-5)
        known = Intrinsics.from_focal(2 * answer.intrinsics.fx, width, height, "EXIF")
        scaled = backend.infer(photo(height, width), Hints(intrinsics=known))
        np.testing.assert_allclose(scaled.depth, 2 * answer.depth, rtol=1e-5)
        assert scaled.intrinsics == known
