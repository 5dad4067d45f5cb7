"""What goes in and what comes out, against transformers' own processors where they run without torchvision."""

from __future__ import annotations
import __future__

import ast
import functools
import importlib.util
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch

from physic_core.adapters.top_down import crop_around_box, resample_crop
from physic_core.types import Hints, People
from physic_transformers import depth_pro, grounded_sam2, zoedepth
from physic_transformers.models import size_from_edges, size_from_target
from physic_transformers.sapiens2 import KEYPOINT_OF_WHOLEBODY, Sapiens2

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SIZES = [(480, 640), (1080, 1920), (640, 300), (97, 131), (24, 32), (799, 1333), (801, 799), (500, 500), (120, 900)]
"""Height and width."""


def photo(height: int, width: int) -> NDArray[np.uint8]:
    """Coarse patches of colour, and fine grain."""
    rng = np.random.default_rng(height * 7 + width)
    coarse = np.kron(rng.integers(0, 256, (-(-height // 16), -(-width // 16), 3)), np.ones((16, 16, 1)))
    grain = rng.integers(-20, 21, (height, width, 3))
    return np.clip(coarse[:height, :width] + grain, 0, 255).astype(np.uint8)


class TestGroundingDino:
    @pytest.mark.parametrize(("height", "width"), SIZES)
    def test_the_pixels_are_those_of_the_library(self, height: int, width: int) -> None:
        from transformers import GroundingDinoImageProcessorPil

        image = photo(height, width)
        theirs = GroundingDinoImageProcessorPil()(images=image, return_tensors="np")["pixel_values"]
        ours = grounded_sam2.detector_pixels(image)
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, atol=2e-6)

    def test_sizes_are_those_of_the_library_everywhere(self) -> None:
        from transformers.image_transforms import get_size_with_aspect_ratio

        rng = np.random.default_rng(0)
        for height, width in rng.integers(8, 3000, (400, 2)).tolist():
            assert size_from_edges(height, width, 800, 1333) == get_size_with_aspect_ratio((height, width), 800, 1333)

    def test_boxes_scores_and_words_are_those_of_the_library(self, saved: Callable[..., Path]) -> None:
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
        ours = grounded_sam2.decode_text_boxes(logits[0].numpy(), boxes[0].numpy(), 0.3, 0.25)
        order = np.argsort(-theirs["scores"].numpy(), kind="stable")
        assert len(order) > 10
        np.testing.assert_allclose(ours.scores, theirs["scores"].numpy()[order], rtol=1e-6)
        np.testing.assert_allclose(ours.boxes * [640, 480, 640, 480], theirs["boxes"].numpy()[order], rtol=1e-5)
        words = [tokenizer.decode(ids[0, list(tokens)]) for tokens in ours.tokens]
        assert words == [theirs["text_labels"][i] for i in order]


class TestDepthPro:
    @pytest.mark.parametrize(("height", "width"), [(480, 640), (1200, 1920), (97, 131)])
    def test_the_pixels_are_normalised_and_resized_without_antialiasing(self, height: int, width: int) -> None:
        image = photo(height, width)
        normal = (torch.from_numpy(image.transpose(2, 0, 1)[None]) / 255 - 0.5) / 0.5
        theirs = torch.nn.functional.interpolate(normal, (768, 768), mode="bilinear", align_corners=False)
        np.testing.assert_allclose(depth_pro.preprocess(image, 768), theirs.numpy(), atol=2e-4)

    def test_depth_and_focal_length_follow_the_formulas_of_the_library(self) -> None:
        rng = np.random.default_rng(3)
        raw = torch.from_numpy(rng.uniform(0.05, 2.0, (1, 24, 24)).astype(np.float32))
        out = SimpleNamespace(predicted_depth=raw, field_of_view=torch.tensor([52.0]))
        height, width = 60, 80
        focal = 0.5 * width / torch.tan(0.5 * torch.deg2rad(out.field_of_view))
        inverse = torch.nn.functional.interpolate((raw * width / focal)[:, None], (height, width), mode="bilinear")
        theirs = 1 / torch.clamp(inverse[0, 0], 1e-4, 1e4)
        backend = depth_pro.DepthPro()
        config = SimpleNamespace(patch_size=6, scaled_images_ratios=[0.25, 0.5, 1])
        backend._network = {"weights": SimpleNamespace(config=config, run=lambda **_: out)}
        answer = backend.infer(photo(height, width), Hints())
        np.testing.assert_allclose(answer.depth, theirs.numpy(), rtol=1e-4)
        assert answer.intrinsics is not None
        assert answer.intrinsics.fx == pytest.approx(float(focal), rel=1e-5)


class TestZoeDepth:
    @pytest.mark.parametrize(("height", "width"), SIZES)
    def test_the_pixels_are_those_of_the_library(self, height: int, width: int) -> None:
        from transformers import ZoeDepthImageProcessorPil

        image = photo(height, width)
        theirs = ZoeDepthImageProcessorPil(ensure_multiple_of=32)(images=image, return_tensors="np")["pixel_values"]
        ours = zoedepth.preprocess(image)
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, atol=2e-5)

    def test_sizes_are_those_of_the_library_everywhere(self) -> None:
        from transformers.models.zoedepth.image_processing_pil_zoedepth import get_resize_output_image_size

        rng = np.random.default_rng(0)
        for height, width in rng.integers(64, 2000, (200, 2)).tolist():
            if max(height, width) < 7 * min(height, width):
                theirs = get_resize_output_image_size(
                    np.empty((3, height, width), np.uint8), (384, 512), True, 32, "channels_first"
                )
                assert size_from_target(height, width, (384, 512), 32) == tuple(map(int, theirs))

    @pytest.mark.parametrize(("height", "width"), [(240, 320), (97, 131), (640, 300)])
    def test_the_frame_is_cut_off_as_the_library_does(self, height: int, width: int) -> None:
        rows, columns = int(np.sqrt(height / 2) * 3), int(np.sqrt(width / 2) * 3)
        depth = np.random.default_rng(2).uniform(1, 5, (96, 128)).astype(np.float32)
        whole = torch.nn.functional.interpolate(
            torch.from_numpy(depth)[None, None], (height + 2 * rows, width + 2 * columns), mode="bilinear"
        )
        theirs = whole[0, 0, rows:-rows, columns:-columns].numpy()
        np.testing.assert_allclose(zoedepth.crop_padding(depth, height, width), theirs, atol=1e-4)


@functools.cache
def functions_of_sapiens2() -> dict[str, Any]:
    """The functions of the library's processor, which needs torchvision, without that processor."""

    def gaussian_blur(maps: torch.Tensor, kernel_size: list[int], sigma: list[float]) -> torch.Tensor:
        reach = torch.arange(kernel_size[0]) - kernel_size[0] // 2
        line = torch.exp(-(reach**2) / (2 * sigma[0] ** 2))
        line = (line / line.sum())[None, None]
        padded = torch.nn.functional.pad(maps[:, None], [kernel_size[0] // 2] * 4, mode="reflect")
        return torch.conv2d(torch.conv2d(padded, line[..., None]), line[:, :, None])[:, 0]

    spec = importlib.util.find_spec("transformers.models.sapiens2")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    source = Path(spec.submodule_search_locations[0], "image_processing_sapiens2.py").read_text()
    wanted = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    names: dict[str, Any] = {
        "torch": torch, "F": torch.nn.functional, "tvF": SimpleNamespace(gaussian_blur=gaussian_blur),
    }  # fmt: skip
    flags = __future__.annotations.compiler_flag
    exec(compile(ast.Module(wanted, []), "image_processing_sapiens2.py", "exec", flags), names)
    return names


class TestSapiens2:
    def test_the_crop_is_that_of_the_library(self) -> None:
        library = functions_of_sapiens2()
        image = photo(240, 320)
        corners = np.array([40.0, 30.0, 150.0, 220.0])
        boxes = torch.tensor([[39.5 + 55, 29.5 + 95, 110.0, 190.0]])  # middle and sides, from the edges of pixels
        theirs = library["crop_and_resize"](torch.from_numpy(image).permute(2, 0, 1).float(), boxes, (256, 192))[0]
        ours = resample_crop(image, crop_around_box(corners, 192, 256, grid="corners"))
        inside = theirs.numpy()[:, 2:-2, 2:-2].transpose(1, 2, 0)
        # The library enlarges by cubic interpolation, we by linear one.
        assert np.abs(ours[2:-2, 2:-2] - inside).mean() < 6
        shifted = np.abs(ours[2:-2, 3:-1] - inside).mean()
        assert shifted > 2 * np.abs(ours[2:-2, 2:-2] - inside).mean()

    def test_points_are_those_of_the_library(self) -> None:
        library = functions_of_sapiens2()
        rng = np.random.default_rng(5)
        cells = rng.uniform([8, 8], [183, 247], (2, 308, 2))
        rows, columns = np.mgrid[:256, :192]
        apart = (columns - cells[..., 0, None, None]) ** 2 + (rows - cells[..., 1, None, None]) ** 2
        heat = (np.exp(-apart / 72) * rng.uniform(0.3, 0.9, (2, 308, 1, 1))).astype(np.float32)
        corners = np.array([[40.0, 30, 150, 220], [160, 20, 300, 90]])
        maps = torch.from_numpy(heat)
        peaks, scores = library["get_keypoint_predictions"](maps)
        peaks = library["post_dark_unbiased_data_processing"](peaks, maps)
        middles = torch.from_numpy(
            np.concatenate([(corners[:, :2] + corners[:, 2:] - 1) / 2, corners[:, 2:] - corners[:, :2]], 1)
        )
        centres, sides = library["boxes_to_crop_params"](middles, output_size=(1024, 768))
        theirs = peaks / torch.tensor([191, 255]) * sides[:, None] + centres[:, None] - 0.5 * sides[:, None]
        backend = Sapiens2()
        config = SimpleNamespace(image_size=[1024, 768], num_labels=308)
        out = SimpleNamespace(heatmaps=maps)
        backend._network = {"weights": SimpleNamespace(config=config, run=lambda **_: out)}
        ours = backend.infer(photo(240, 320), People(np.ones((2, 240, 320), bool), corners, np.array([0.9, 0.8])))
        own = list(KEYPOINT_OF_WHOLEBODY.values())
        np.testing.assert_allclose(ours.points[:, list(KEYPOINT_OF_WHOLEBODY)], theirs.numpy()[:, own], atol=0.02)
        np.testing.assert_allclose(ours.confidence[:, list(KEYPOINT_OF_WHOLEBODY)], scores.numpy()[:, own], atol=1e-6)
        assert (ours.confidence[:, 23:91] == 0).all(), "the face"

    def test_every_keypoint_is_the_one_of_the_same_name(self) -> None:
        """Names as both projects list them: Sapiens2's fingers begin at the tip, its wrist comes after its hand."""
        body = (
            *("nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder"),
            *("left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee"),
            *("right_knee", "left_ankle", "right_ankle", "left_big_toe", "left_small_toe", "left_heel"),
            *("right_big_toe", "right_small_toe", "right_heel"),
        )
        sapiens = [name for name in body if "wrist" not in name]
        coco = dict(enumerate(body))
        fingers = ("thumb", "index", "middle", "ring", "pinky")
        for side, first in (("left", 91), ("right", 112)):
            coco |= {first: f"{side}_wrist"}
            coco |= {first + 1 + 4 * f + k: f"{side}_{fingers[f]}{k + 1}" for f in range(5) for k in range(4)}
        for side in ("right", "left"):
            sapiens += [f"{side}_{finger}{4 - k}" for finger in fingers for k in range(4)] + [f"{side}_wrist"]
        assert {whole: sapiens[own] for whole, own in KEYPOINT_OF_WHOLEBODY.items()} == coco
