"""Every backend with a network that knows the world which the photo shows, through the whole
conformance kit.

The networks answer what a perfect one would, in their own frames, by formulas that are written here
apart from those of the backends. They also look at what they are fed: a picture that does not show
the photo, upright and in RGB, is refused.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter, map_coordinates

from physic_core.errors import NoPersonError
from physic_core.types import PeoplePrompt
from physic_testing import check_backend, load_world, world_of
from physic_transformers.depth_pro import DepthPro
from physic_transformers.grounded_sam2 import GroundedSam2
from physic_transformers.sam3 import Sam3

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
HALF = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))


class StandIn:
    """A stand-in of a network that is given the photo which it is about to see.

    Attributes:
        world: what the photo shows; None where it is not a world's.
        people: whether its people are in the photo.
    """

    config: Any = None
    tokenizer: Any = None

    def show(self, image: UInt8Array) -> None:
        self.image = image
        self.world = world_of(image)
        self.people = self.world is not None and not np.array_equal(image, self.world.empty_image)

    @property
    def size(self) -> tuple[int, int]:
        return self.image.shape[0], self.image.shape[1]

    @property
    def depth(self) -> np.ndarray:
        """(H, W) metres, inf in the sky; a made-up ground where the photo is not a world's."""
        if self.world is None:
            rows = np.linspace(1.0, 0.2, self.size[0])
            return np.broadcast_to(2 * rows[:, None], self.size)
        return self.world.depth if self.people else self.world.empty_depth

    def masks(self) -> np.ndarray:
        """(N, H, W) bool."""
        return (
            self.world.masks
            if self.world is not None and self.people
            else np.zeros((0, *self.size), bool)
        )

    def floor(self) -> np.ndarray:
        """(H, W) bool."""
        if self.world is None:
            return np.zeros(self.size, bool)
        return self.world.floor_mask if self.people else self.world.empty_floor_mask


def squashed(values, rows, columns):
    """A map of the photo at the pixels of another grid over it, cells of both meeting at the
    edges.
    """
    height, width = values.shape
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    return map_coordinates(values, np.meshgrid(v, u, indexing="ij"), order=1, mode="nearest")


def soft(mask, rows, columns):
    """Logits of a mask over the photo on a grid."""
    blur = 0.3 * max(mask.shape[0] / rows, mask.shape[1] / columns)
    return 20 * squashed(gaussian_filter(mask.astype(float), blur) - 0.5, rows, columns)


def batch(values):
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))[None]


def require_shown(pixels, seen, mean, std):
    """Refuse pixels (3, h, w) that are not those of ``seen`` (h, w, 3), 0..1, or that are
    normalised otherwise.
    """
    shown = pixels.transpose(1, 2, 0) * np.array(std) + np.array(mean)
    assert np.abs(shown - seen).mean() < 0.06, "the network was shown another picture"
    assert pixels.dtype == np.float32


def photo_at(image, rows, columns):
    """(rows, columns, 3) in 0..1: each pixel the mean of those it covers."""
    blurs = [0.4 * max(0, a / b - 1) for a, b in zip(image.shape, (rows, columns), strict=False)]
    smooth = gaussian_filter(image / 255, (*blurs, 0))
    return np.stack([squashed(smooth[..., c], rows, columns) for c in range(3)], -1)


class DepthProStandIn(StandIn):
    config = SimpleNamespace(patch_size=96, scaled_images_ratios=[0.25, 0.5, 1])

    def run(self, *, pixel_values: np.ndarray) -> Any:
        assert pixel_values.shape == (1, 3, 384, 384)
        require_shown(pixel_values[0], photo_at(self.image, 384, 384), *HALF)
        width = self.size[1]
        focal = 1.1 * width if self.world is None else self.world.intrinsics.fx
        raw = squashed(focal / width / self.depth, 384, 384)
        angle = np.degrees(2 * np.arctan(width / 2 / focal))
        return SimpleNamespace(predicted_depth=batch(raw), field_of_view=torch.tensor([angle]))


class Words:
    """A tokenizer that knows two texts."""

    def __init__(self, *known: str) -> None:
        self.known = known

    def __call__(self, text: str, **kwargs: Any) -> dict[str, Any]:
        ids = [[101, 7 + self.known.index(text), 102]]
        if (length := kwargs.get("max_length")) is not None:
            ids = [ids[0] + [0] * (length - 3)]
        mask = [[int(i > 0) for i in ids[0]]]
        return {"input_ids": ids, "token_type_ids": [[0] * len(ids[0])], "attention_mask": mask}


class GroundingDinoStandIn(StandIn):
    tokenizer = Words("person.", "ground, floor, carpet.")

    def run(self, **inputs: np.ndarray) -> Any:
        rows, columns = inputs["pixel_values"].shape[2:]
        assert min(rows, columns) == 800 or max(rows, columns) in (1332, 1333)
        require_shown(inputs["pixel_values"][0], photo_at(self.image, rows, columns), *IMAGENET)
        assert inputs["pixel_mask"].shape == (1, rows, columns)
        person = inputs["input_ids"][0, 1] == 7
        found = [mask for mask in (self.masks() if person else self.floor()[None]) if mask.any()]
        height, width = self.size
        boxes = np.full((1, 20, 4), 0.5)
        logits = np.full((1, 20, 256), -np.inf)
        logits[..., :3] = -4.0
        for q, mask in enumerate(found):
            columns_ = np.flatnonzero(mask.any(0))
            rows_ = np.flatnonzero(mask.any(1))
            x0 = columns_[0]
            y0 = rows_[0]
            x1 = columns_[-1] + 1
            y1 = rows_[-1] + 1
            boxes[0, q] = (
                (x0 + x1) / 2 / width,
                (y0 + y1) / 2 / height,
                (x1 - x0) / width,
                (y1 - y0) / height,
            )
            logits[0, q, 1] = 2.0 - 0.1 * q
        return SimpleNamespace(logits=torch.from_numpy(logits), pred_boxes=torch.from_numpy(boxes))


class Sam2StandIn(StandIn):
    config = SimpleNamespace(prompt_encoder_config=SimpleNamespace(image_size=1024, patch_size=16))
    encoded = 0

    def run(self, method: str = "", /, **inputs: Any) -> Any:
        if method:
            assert method == "get_image_embeddings"
            require_shown(inputs["pixel_values"][0], photo_at(self.image, 1024, 1024), *IMAGENET)
            self.encoded += 1
            return "embeddings"
        assert inputs["image_embeddings"] == "embeddings"
        assert inputs["multimask_output"] is False
        if "input_points" in inputs:
            assert inputs["input_points"].shape == (1, inputs["input_labels"].size, 1, 2)
            marked = np.stack([self._marked(x, y) for x, y in inputs["input_points"][0, :, 0]])
            return SimpleNamespace(pred_masks=torch.from_numpy(marked[None]))
        prompts = inputs["input_boxes"]
        assert prompts.dtype == np.float32
        assert prompts.shape == (1, prompts.shape[1], 4)
        return SimpleNamespace(
            pred_masks=torch.from_numpy(np.stack([self._mask(box) for box in prompts[0]])[None])
        )

    def _mask(self, box: np.ndarray) -> np.ndarray:
        """(1, 256, 256) logits of whatever has this box, px of 1024 x 1024."""
        height, width = self.size
        known = [*self.masks(), self.floor()]
        edges = np.array(
            [_edges(mask) * np.tile([1024 / width, 1024 / height], 2) for mask in known]
        )
        gap = np.abs(edges - box).max(1)
        assert gap.min() < 8, "no such thing in the photo"
        return soft(known[int(gap.argmin())], 256, 256)[None]

    def _marked(self, x: float, y: float) -> np.ndarray:
        """(1, 256, 256) logits of the person at a pixel of 1024 x 1024; negative where nobody
        is.
        """
        height, width = self.size
        on = [mask for mask in self.masks() if mask[int(y * height / 1024), int(x * width / 1024)]]
        return soft(on[0], 256, 256)[None] if on else np.full((1, 256, 256), -9.0)


class Sam3StandIn(StandIn):
    config = SimpleNamespace(image_size=1008)
    tokenizer = Words("person", "ground", "floor", "carpet")

    def run(self, method: str = "", /, **inputs: Any) -> Any:
        if method:
            assert method == "get_vision_features"
            require_shown(inputs["pixel_values"][0], photo_at(self.image, 1008, 1008), *HALF)
            return "seen"
        assert inputs["vision_embeds"] == "seen"
        assert inputs["input_ids"].shape == inputs["attention_mask"].shape == (1, 32)
        assert inputs["attention_mask"].sum() == 3
        masks = self.masks() if inputs["input_ids"][0, 1] == 7 else self.floor()[None]
        height, width = self.size
        boxes = np.zeros((1, 20, 4))
        logits = np.full((1, 20), -6.0)
        found = np.full((1, 20, 288, 288), -9.0)
        for q, mask in enumerate(masks):
            found[0, q], logits[0, q] = soft(mask, 288, 288), 3.0 - 0.1 * q
            if mask.any():
                boxes[0, q] = _edges(mask) / np.tile([width, height], 2)
        whole = soft(masks.any(0), 288, 288)[None, None]
        answer = {
            "pred_masks": found,
            "pred_boxes": boxes,
            "pred_logits": logits,
            "semantic_seg": whole,
        }
        answer["presence_logits"] = np.full((1, 1), 5.0)
        return SimpleNamespace(**{name: torch.from_numpy(value) for name, value in answer.items()})


def _edges(mask):
    columns = np.flatnonzero(mask.any(0))
    rows = np.flatnonzero(mask.any(1))
    return (
        np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)
        if len(rows)
        else np.full(4, -1e4)
    )


def on_arrays(network):
    """Give a stand-in its pixels as an array."""
    run = network.run

    def on_array(*method, **inputs):
        return run(
            *method,
            **{name: np.asarray(v) if name == "pixel_values" else v for name, v in inputs.items()},
        )

    network.run = on_array
    return network


class Telling:
    """Puts stand-ins where a backend would load real networks, and gives them the photo."""

    stand_ins: tuple[tuple[str, Any], ...]

    def missing(self) -> tuple[str, ...]:
        return ()

    def build(self, device: str) -> Any:
        return {option: on_arrays(make()) for option, make in self.stand_ins}

    def infer(self, image: Any, *rest: Any) -> Any:
        if getattr(image, "ndim", 0) == 3:
            for network in (self._network or {}).values():
                network.show(image)
                if hasattr(network, "show_people"):
                    network.show_people(rest[0].boxes)
        return super().infer(image, *rest)


class TellingDepthPro(Telling, DepthPro):
    stand_ins = (("weights", DepthProStandIn),)


class TellingGroundedSam2(Telling, GroundedSam2):
    stand_ins = (("detector", GroundingDinoStandIn), ("masks", Sam2StandIn))


class TellingSam3(Telling, Sam3):
    stand_ins = (("weights", Sam3StandIn),)


ACCURATE = {"IoU": 0.97, "floor IoU": 0.98, "found": 1.0}
WRONG = {"abs-rel": 0.001, "abs-rel, aligned": 0.001, "px": 0.05}
"""What is lost between a perfect network and the answer: half a pixel would be more."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", Telling.__subclasses__(), ids=lambda kind: kind.__name__)
def test_a_backend_with_a_perfect_network_holds_its_contract(kind):
    own = frozenset(getattr(kind, "capabilities", ()))
    report = check_backend(kind, capabilities=own | {"exact"})
    print(report.text)
    report.raise_if_failed()
    bounds = [
        report.accuracy[name] >= least
        for name, least in ACCURATE.items()
        if name in report.accuracy
    ]
    bounds += [
        report.accuracy[name] <= most for name, most in WRONG.items() if name in report.accuracy
    ]
    assert bounds
    assert all(bounds), report.accuracy


def test_points_and_boxes_are_prompts_of_sam_2():
    world = load_world("sit_side_by_side", (320, 240))
    backend = TellingGroundedSam2()
    backend.load()
    rows, columns = world.masks[1].nonzero()
    middle = len(rows) // 2
    point = (float(columns[middle]), float(rows[middle]))
    chosen = PeoplePrompt(points=(point,), boxes=(tuple(world.boxes[0].tolist()),))
    people = backend.infer(world.image, chosen)
    assert people.floor is not None
    for mask, true in zip(people.masks, world.masks[[1, 0]], strict=True):
        assert (mask & true).sum() / (mask | true).sum() > 0.97
    given = PeoplePrompt(points=(point,), masks=world.masks[:1])
    assert (backend.infer(world.image, given).masks[1] == world.masks[0]).all()
    nobody = np.argwhere(~world.masks.any(0))[0]
    with pytest.raises(NoPersonError, match="no person was found at point 1"):
        backend.infer(world.image, PeoplePrompt(points=((float(nobody[1]), float(nobody[0])),)))
