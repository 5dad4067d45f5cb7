"""EoMT: the real class with random weights, exported, and a network that knows what it is shown."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.adapters.panoptic import COCO_PANOPTIC, FLOOR_CLASSES
from physic_core.errors import BackendError
from physic_onnx.eomt import Eomt, EomtOptions
from physic_testing import build_world, check_backend

PERSON, GROUND, WALL, NONE = 0, COCO_PANOPTIC.index("floor-other-merged"), COCO_PANOPTIC.index("wall-other-merged"), 133
PORTS = (
    {"pixel_values": ("float32", (1, 3, 640, 640))},
    {"class_queries_logits": ("float32", (1, 100, 134)), "masks_queries_logits": ("float32", (1, 100, 160, 160))},
)


def answer(shown, feed):
    """What a perfect network says of the padded square: a query a person, one for the ground, one for the rest."""
    classes, masks = np.full((1, 100, 134), -4.0), np.full((1, 100, 160, 160), -9.0)
    classes[..., NONE] = 6
    if shown.world is not None:
        people = shown.world.masks if shown.people else shown.world.masks[:0]
        floor = shown.world.floor_mask if shown.people else shown.world.empty_floor_mask
        rest = ~(people.any(axis=0) | floor)
        for q, (label, mask) in enumerate([*[(PERSON, m) for m in people], (GROUND, floor), (WALL, rest)]):
            classes[0, 3 * q, NONE], classes[0, 3 * q, label] = -4, 9 - 0.2 * q
            masks[0, 3 * q] = in_square(mask)
    return {"class_queries_logits": classes, "masks_queries_logits": masks}


def in_square(mask):
    """A mask of the photo, scaled to fit 640 px and put at the top left, as logits of 160 x 160 cells."""
    height, width = mask.shape
    scale = 640 / max(mask.shape)
    size = (max(1, round(height * scale)), max(1, round(width * scale)))
    share = torch.nn.functional.interpolate(torch.tensor(mask, dtype=torch.float32)[None, None], size, mode="bilinear")
    square = torch.zeros(1, 1, 640, 640)
    square[..., : size[0], : size[1]] = share
    return 18 * torch.nn.functional.interpolate(square, (160, 160), mode="area")[0, 0].numpy() - 9


@pytest.fixture(scope="module")
def eomt(stand_in, stand_in_network):
    def attach(backend):
        network = stand_in_network(*PORTS, answer)
        backend.bind(network)
        backend.network = network
        return (network,)

    return stand_in(Eomt, attach)


def test_conformance(eomt):
    check_backend(eomt).raise_if_failed()


@pytest.mark.parametrize("size", [(320, 240), (240, 320)])
def test_people_and_floor_of_a_world(eomt, size):
    """The padding is undone for photos that are wide and for photos that are high."""
    world = build_world("stand", 0, size)
    backend = eomt()
    backend.load()
    people = backend.infer(world.image)
    (mask,) = people.masks
    assert (mask & world.masks[0]).sum() / (mask | world.masks[0]).sum() > 0.9
    assert people.floor is not None
    assert (people.floor & world.floor_mask).sum() / (people.floor | world.floor_mask).sum() > 0.9


def test_the_network_sees_red_first_normalised_beside_black(eomt):
    """Black is put round the photo before it is normalised: it is not the network's nought."""
    photo = np.zeros((100, 200, 3), np.uint8)
    photo[..., 0] = 255
    backend = eomt()
    backend.load()
    backend.infer(photo)
    frame = backend.network.fed["pixel_values"][0]
    assert frame[:, 5, 600] == pytest.approx([(1 - 0.485) / 0.229, -0.456 / 0.224, -0.406 / 0.225], abs=1e-4)
    assert frame[:, 600, 5] == pytest.approx([-0.485 / 0.229, -0.456 / 0.224, -0.406 / 0.225], abs=1e-4)


def test_the_option_floor_false_returns_no_floor(eomt):
    backend = eomt(EomtOptions(floor=False))
    backend.load()
    assert backend.infer(build_world("stand", 0, (320, 240)).image).floor is None


def test_another_number_of_classes_is_refused(graph, node, tmp_path):
    ports = {"class_queries_logits": ("float32", (1, 9, 151)), "masks_queries_logits": ("float32", (1, 9, 40, 40))}
    nodes = [
        node("ReduceMean", ["pixel_values"], ["mean"], keepdims=0),
        node("Expand", ["mean", "classes"], ["class_queries_logits"]),
        node("Expand", ["mean", "masks"], ["masks_queries_logits"]),
    ]
    constants = {"classes": np.array([1, 9, 151]), "masks": np.array([1, 9, 40, 40])}
    path = graph(tmp_path / "eomt.onnx", PORTS[0], ports, nodes, constants)
    with pytest.raises(BackendError, match=r"class_queries_logits float32 \(1, 9, 151\) has another form"):
        Eomt(EomtOptions(weights=str(path))).load()


@pytest.fixture(scope="module")
def tiny(module_at, tmp_path_factory):
    """The real class, small and random, and the file that the tool makes of it."""
    transformers = pytest.importorskip("transformers")
    torch.manual_seed(0)
    config = transformers.EomtConfig(
        hidden_size=32, num_hidden_layers=2, num_attention_heads=2, image_size=160, patch_size=16, num_queries=12,
        num_blocks=1, num_upscale_blocks=2, num_labels=133, num_register_tokens=1,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("eomt")
    model = transformers.EomtForUniversalSegmentation(config).eval()
    model.save_pretrained(folder / "checkpoint")
    module_at("tools/export_eomt.py").export(str(folder / "checkpoint"), folder / "model.onnx")
    return model, folder / "model.onnx"


def test_the_real_class_answers_the_same(tiny):
    """Our picture, the exported network and our masks against the library's processor and the class itself."""
    transformers = pytest.importorskip("transformers")
    model, path = tiny
    photo = build_world("stand", 0, (320, 240)).image
    sides = {"shortest_edge": 160, "longest_edge": 160}
    processor = transformers.EomtImageProcessorPil(do_pad=True, size=sides)
    values = processor.preprocess(photo, return_tensors="pt")["pixel_values"]
    with torch.no_grad():
        theirs = model(pixel_values=values)
    backend = Eomt(EomtOptions(weights=str(path), threads=1))
    backend.load()
    captured = {}
    run = backend.loaded().network.run

    def spy(feed, outputs):
        captured.update(feed)
        captured["answers"] = run(feed, outputs)
        return captured["answers"]

    backend.loaded().network.run = spy
    backend.infer(photo)
    assert captured["pixel_values"] == pytest.approx(values.numpy(), abs=0.02), "half a grey level"
    assert np.abs(captured["answers"][0] - theirs.class_queries_logits.numpy()).max() < 0.02
    assert np.abs(captured["answers"][1] - theirs.masks_queries_logits.numpy()).max() < 0.1


def test_floors_of_the_list_are_in_the_network_s_list():
    floors = {COCO_PANOPTIC.index(name) for name in FLOOR_CLASSES}
    assert floors == {87, 90, 96, 97, 100, 102, 105, 122, 123, 125, 126, 132}
