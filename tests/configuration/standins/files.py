"""Files with the names and contracts of published ones, which hold the truth of one world: ONNX, TorchScript."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import onnx
import torch

from physic_testing.conformance.true_keypoints import world_keypoints
from physic_testing.worlds import World

from .neighbours import neighbour

UNIT, SHIFT = 2.2, 0.7
"""Metres a unit of a relative network's points, and by how many of those its z is short."""
HEIGHT, WIDTH, ROWS, COLUMNS = 256, 192, 64, 48
PADDING = 1.25


def write_vitpose(folder: Path, world: World) -> None:
    """ViTPose-H with 133 joints, its tensors beside it: heat maps of the world's one person, whatever is shown."""
    neighbours = neighbour("physic-onnx", "conftest")
    node = onnx.helper.make_node
    plain = neighbours.write_graph(
        folder / "plain.onnx",
        {"input_0": ("float32", ("batch", 3, HEIGHT, WIDTH))},
        {"output_0": ("float32", ("batch", 133, ROWS, COLUMNS))},
        [
            node("Shape", ["input_0"], ["size"]),
            node("Gather", ["size", "first"], ["people"]),
            node("Concat", ["people", "ones"], ["repeats"], axis=0),
            node("Expand", ["maps", "repeats"], ["output_0"]),
        ],
        {"first": np.array([0]), "ones": np.ones(3, np.int64), "maps": heat_maps(world)},
    )
    graph = folder / "vitpose_h_wholebody_model.onnx"
    tensors = "vitpose_h_wholebody_data.bin"
    onnx.save_model(onnx.load(plain), graph, save_as_external_data=True, location=tensors, size_threshold=1000)
    plain.unlink()
    assert (folder / tensors).is_file()


def heat_maps(world: World) -> np.ndarray:
    """(1, 133, 64, 48) float32 of the first person; cell q is pixel 4 q of the crop, as its training had it."""
    points, seen = world_keypoints(world, "coco_wholebody133")
    box = world.boxes[0]
    wide, high = box[2:] - box[:2]
    size = PADDING * np.array([max(wide, high * WIDTH / HEIGHT), max(high, wide * HEIGHT / WIDTH)])
    corner = (box[:2] + box[2:] - 1 - size) / 2
    cells = (points[0] - corner) / size * [COLUMNS, ROWS]
    y, x = np.mgrid[:ROWS, :COLUMNS]
    apart = (x - cells[:, 0, None, None]) ** 2 + (y - cells[:, 1, None, None]) ** 2
    sure = np.where(seen[0], 0.9, 0.3)[:, None, None]
    return (sure * np.exp(-apart / 8)).astype(np.float32)[None]


def write_moge_2(folder: Path, world: World) -> None:
    """MoGe-2: the points of the photo that it is shown, with or without the people."""
    neighbours = neighbour("physic-onnx", "conftest")
    node = onnx.helper.make_node
    planes = ("batch", 3, "height", "width")
    points = ("float32", ("batch", "height", "width", 3))
    constants: dict[str, np.ndarray] = {"none": np.float32(0), "unit": np.array([UNIT], np.float32)}
    for name, photo, people in (("full", world.image, True), ("empty", world.empty_image, False)):
        seen, mask = relative_points(world, people=people)
        constants |= {
            f"{name}_photo": (photo.transpose(2, 0, 1)[None] / 255).astype(np.float32),
            f"{name}_points": seen[None],
            f"{name}_mask": mask[None],
        }
    nodes = [
        part
        for name in ("full", "empty")
        for part in (
            node("Sub", ["image", f"{name}_photo"], [f"{name}_off"]),
            node("Abs", [f"{name}_off"], [f"{name}_apart"]),
            node("ReduceMean", [f"{name}_apart"], [f"{name}_mean"], keepdims=0),
        )
    ]
    nodes += [
        node("Less", ["full_mean", "empty_mean"], ["people"]),
        node("Where", ["people", "full_points", "empty_points"], ["points"]),
        node("Where", ["people", "full_mask", "empty_mask"], ["mask"]),
        node("Mul", ["points", "none"], ["normal"]),
        node("Cast", ["num_tokens"], ["tokens"], to=onnx.TensorProto.FLOAT),
        node("Mul", ["tokens", "none"], ["nothing"]),
        node("Add", ["unit", "nothing"], ["scale"]),
    ]
    neighbours.write_graph(
        folder / "model.onnx",
        {"image": ("float32", planes), "num_tokens": ("int64", ())},
        {
            "points": points,
            "normal": points,
            "mask": ("float32", ("batch", "height", "width")),
            "scale": ("float32", ("batch",)),
        },
        nodes,
        constants,
    )


def relative_points(world: World, *, people: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points (H, W, 3) up to a scale and a shift along z, and (H, W) how sure it is that they are a surface."""
    points = world.points(people=people).astype(np.float64)
    seen = np.isfinite(points).all(axis=-1)
    found = np.where(seen[..., None], points, 1.0) / UNIT - [0, 0, SHIFT]
    return found.astype(np.float32), np.where(seen, 0.95, 0.02).astype(np.float32)


class _Lama(torch.nn.Module):
    """Fills the hole with what is behind the people, and hands the rest through."""

    def __init__(self, empty: torch.Tensor) -> None:
        super().__init__()
        self.register_buffer("empty", empty)

    def forward(self, image, mask):  # type: ignore[no-untyped-def]
        hole = (mask > 0).to(image.dtype)
        return image * (1 - hole) + self.empty * hole


def write_lama(folder: Path, world: World) -> None:
    """LaMa as TorchScript, 0 to 1 in and out."""
    folder.mkdir(parents=True, exist_ok=True)
    empty = torch.from_numpy((world.empty_image.transpose(2, 0, 1)[None] / 255).astype(np.float32))
    with warnings.catch_warnings():  # torch has newer formats, but the file is published in this one
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.script(_Lama(empty)).save(str(folder / "big-lama.pt"))
