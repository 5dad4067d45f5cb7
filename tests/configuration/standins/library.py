"""The classes of transformers that the presets run, small and random, whose answers are replaced by a world's truth.

The networks are real: they are saved and read as published ones are, take what they are fed through all of their
layers, and only the numbers that come out are exchanged for right ones of the same shape.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from physic_testing.worlds import World

from .neighbours import neighbour
from .pictures import edges, logits, on_grid, shows_people

Normal = tuple[tuple[float, ...], tuple[float, ...]]
"""Mean and deviation."""
IMAGENET: Normal = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
HALF: Normal = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))


def save_networks(weights: Path) -> None:
    """GroundingDINO, SAM 2.1, SAM 3 and DepthPro in the folders of their sets; SAM's at their published input sizes."""
    from transformers import Sam2Config, Sam2Model, Sam3Config, Sam3Model
    from transformers.utils import logging

    tiny = neighbour("physic-transformers", "conftest")
    two, three = tiny.sam2_config(), tiny.sam3_config()
    two["vision_config"]["backbone_config"]["image_size"] = [1024, 1024]
    two["vision_config"]["backbone_feature_sizes"] = [[256, 256], [128, 128], [64, 64]]
    two["prompt_encoder_config"]["image_size"] = 1024
    three["vision_config"]["backbone_config"]["image_size"] = 1008
    three["vision_config"]["backbone_feature_sizes"] = [[288, 288], [144, 144], [72, 72]]
    made: dict[str, Callable[[], Any]] = {
        "grounding-dino-base-hf": tiny.grounding_dino,
        "sam2.1-hiera-large-hf": lambda: Sam2Model(Sam2Config(**two)),
        "sam3-hf": lambda: Sam3Model(Sam3Config(**three)),
        "depth-pro-hf": tiny.depth_pro,
    }
    logging.disable_progress_bar()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        for name, make in made.items():
            make().save_pretrained(str(weights / name))
    logging.enable_progress_bar()
    tiny.write_bert_tokenizer(weights / "grounding-dino-base-hf")
    tiny.write_clip_tokenizer(weights / "sam3-hf")


def tell(monkeypatch: pytest.MonkeyPatch, world: World, own_focal: float = 1.0) -> dict[str, int]:
    """Replace the answers of the four classes; returns how often each was asked, counted on.

    Args:
        monkeypatch: pytest's.
        world: what they know.
        own_focal: the focal length that DepthPro sees, in the world's; its depth in metres is as much larger.
    """
    import transformers

    asked: dict[str, int] = {}
    height, width = world.image.shape[:2]
    size = np.array([width, height, width, height])

    def replace(kind: str, answer: Callable[[Any, dict[str, Any]], None]) -> None:
        network = getattr(transformers, kind)
        forward = network.forward

        def replaced(self: Any, **inputs: Any) -> Any:
            asked[kind] = asked.get(kind, 0) + 1
            out = forward(self, **inputs)
            answer(out, inputs)
            return out

        monkeypatch.setattr(network, "forward", replaced)

    def grounding_dino(out: Any, inputs: dict[str, Any]) -> None:
        assert shows_people(world, _picture(inputs["pixel_values"], IMAGENET))
        person = 6 in inputs["input_ids"]  # "person" in the tiny tokenizer's list
        out.logits[:] = -torch.inf
        out.logits[..., : inputs["input_ids"].shape[1]] = -4
        for row, mask in enumerate(world.masks if person else [world.floor_mask]):
            x0, y0, x1, y1 = edges(mask) / size
            out.pred_boxes[0, row] = torch.tensor([(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0])
            out.logits[0, row, 1] = 2 - 0.1 * row

    def sam2(out: Any, inputs: dict[str, Any]) -> None:
        known = [*world.masks, world.floor_mask]
        boxes = np.array([edges(mask) for mask in known]) * 1024 / size
        for row, box in enumerate(inputs["input_boxes"][0].numpy()):
            apart = np.abs(boxes - box).max(1)
            assert apart.min() < 8, "nothing of the world is in this box"
            mask = known[int(apart.argmin())]
            _fill(out.pred_masks[0, row, 0], lambda h, w, m=mask: logits(m, h, w))

    def sam3(out: Any, inputs: dict[str, Any]) -> None:
        out.pred_logits[:], out.presence_logits[:], out.pred_masks[:] = -6, 5, -9
        for row, mask in enumerate(world.masks):
            _fill(out.pred_masks[0, row], lambda h, w, m=mask: logits(m, h, w))
            out.pred_boxes[0, row] = torch.from_numpy(edges(mask) / size)
            out.pred_logits[0, row] = 3 - 0.1 * row
        _fill(out.semantic_seg[0, 0], lambda h, w: logits(world.floor_mask, h, w))

    def depth_pro(out: Any, inputs: dict[str, Any]) -> None:
        people = shows_people(world, _picture(inputs["pixel_values"], HALF))
        depth = world.depth if people else world.empty_depth
        focal = world.intrinsics.fx
        _fill(out.predicted_depth[0], lambda h, w: on_grid(focal / width / depth, h, w))
        out.field_of_view[:] = float(np.degrees(2 * np.arctan(width / 2 / (own_focal * focal))))

    def look(kind: str, method: str, normal: Normal) -> None:
        network = getattr(transformers, kind)
        encode = getattr(network, method)

        def looking(self: Any, pixel_values: torch.Tensor, **rest: Any) -> Any:
            assert shows_people(world, _picture(pixel_values, normal))
            return encode(self, pixel_values=pixel_values, **rest)

        monkeypatch.setattr(network, method, looking)

    look("Sam2Model", "get_image_embeddings", IMAGENET)
    look("Sam3Model", "get_vision_features", HALF)
    replace("GroundingDinoForObjectDetection", grounding_dino)
    replace("Sam2Model", sam2)
    replace("Sam3Model", sam3)
    replace("DepthProForDepthEstimation", depth_pro)
    return asked


def save_flux(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of FLUX.1-dev with its transformer, small; diffusers too, where that is not installed."""
    base.mkdir(parents=True)
    (base / "model_index.json").write_text("{}")
    if importlib.util.find_spec("diffusers") is None:
        module = ModuleType("diffusers")
        module.FluxTransformer2DModel = _Flux  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "diffusers", module)
        return
    from diffusers import FluxTransformer2DModel

    FluxTransformer2DModel(
        patch_size=1, in_channels=4, num_layers=1, num_single_layers=1, attention_head_dim=16, num_attention_heads=2,
        joint_attention_dim=32, pooled_projection_dim=32, axes_dims_rope=(4, 4, 8),
    ).save_pretrained(base / "transformer")  # fmt: skip


class _Flux:
    """As much of FLUX's transformer as is looked at before it runs."""

    def __init__(self) -> None:
        self.x_embedder, self.config = torch.nn.Linear(4, 32), SimpleNamespace(in_channels=4)

    @classmethod
    def from_pretrained(cls, base: str, *, subfolder: str, torch_dtype: Any, local_files_only: bool) -> _Flux:
        assert (subfolder, local_files_only) == ("transformer", True)
        return cls()

    def register_to_config(self, **changes: Any) -> None:
        vars(self.config).update(changes)


def _picture(pixels: torch.Tensor, normal: Normal) -> np.ndarray:
    """(h, w, 3), 0 to 1, of what a network is fed."""
    return np.asarray(pixels[0].float().numpy().transpose(1, 2, 0) * np.array(normal[1]) + np.array(normal[0]))


def _fill(tensor: torch.Tensor, values: Callable[[int, int], np.ndarray]) -> None:
    tensor[:] = torch.from_numpy(np.ascontiguousarray(values(*tensor.shape), np.float32))
