"""SAM 2 in both of its signatures: graphs of their contract, and networks that know what they are
shown.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import torch

from physic_core.errors import BackendError
from physic_core.types import Keypoints, People
from physic_onnx.detectors import Detector
from physic_onnx.sam2 import Sam2, Sam2Options
from physic_onnx.sam2_floor import feet_positions, ground_points
from physic_onnx.sam2_networks import Sam2Networks, find_sam2_files, open_sam2
from physic_onnx.sessions import OnnxOptions
from physic_testing import check_backend, load_world

FEATURES = {
    "transformers.js": ("image_embeddings.0", "image_embeddings.1", "image_embeddings.2"),
    "samexporter": ("high_res_feats_0", "high_res_feats_1", "image_embed"),
}
PICTURE = {"transformers.js": "pixel_values", "samexporter": "image"}
MAPS = ((1, 32, 256, 256), (1, 64, 128, 128), (1, 256, 64, 64))
ENCODER = {
    signature: (
        {PICTURE[signature]: ("float32", (1, 3, 1024, 1024))},
        {name: ("float32", shape) for name, shape in zip(FEATURES[signature], MAPS, strict=True)},
    )
    for signature in FEATURES
}
DECODER = {
    "transformers.js": (
        {
            "input_points": ("float32", ("b", "n", "p", 2)),
            "input_labels": ("int64", ("b", "n", "p")),
            "input_boxes": ("float32", ("b", "boxes", 4)),
            **ENCODER["transformers.js"][1],
        },
        {
            "iou_scores": ("float32", ("b", "n", 3)),
            "pred_masks": ("float32", ("b", "n", 3, 256, 256)),
            "object_score_logits": ("float32", ("b", "n", 1)),
        },
    ),
    "samexporter": (
        {
            "image_embed": ("float32", MAPS[2]),
            "high_res_feats_0": ("float32", MAPS[0]),
            "high_res_feats_1": ("float32", MAPS[1]),
            "point_coords": ("float32", ("n", "p", 2)),
            "point_labels": ("float32", ("n", "p")),
            "mask_input": ("float32", ("n", 1, 256, 256)),
            "has_mask_input": ("float32", (1,)),
        },
        {"masks": ("float32", ("n", "m", 256, 256)), "iou_predictions": ("float32", ("n", 3))},
    ),
}


def networks_of(signature, stand_in_network, answer=None, encoder_ports=None):
    def encode(shown, feed):
        return {
            name: np.zeros(shape, np.float32)
            for name, shape in zip(FEATURES[signature], MAPS, strict=True)
        }

    encoder = stand_in_network(*(encoder_ports or ENCODER[signature]), encode)
    return encoder, stand_in_network(*DECODER[signature], answer or (lambda shown, feed: {}))


def test_the_tracker_of_sam_3_gets_values_from_minus_1_to_1(stand_in_network, shown):
    ports = ({"pixel_values": ("float32", (1, 3, 1008, 1008))}, ENCODER["transformers.js"][1])
    encoder, decoder = networks_of("transformers.js", stand_in_network, encoder_ports=ports)
    photo = np.full((30, 40, 3), 255, np.uint8)
    encoder.show(shown(photo))
    Sam2Networks(encoder, decoder).encode(photo)
    assert encoder.fed["pixel_values"] == pytest.approx(1.0)


def prompts_fed(signature, answer, stand_in_network, shown):
    """What the decoder is fed for two boxes, and for a point inside and one outside, of a photo of
    256 x 512 px.
    """
    fed = []

    def record(photo, feed):
        fed.append(feed)
        return answer(feed)

    encoder, decoder = networks_of(signature, stand_in_network, record)
    photo = np.zeros((512, 256, 3), np.uint8)
    encoder.show(shown(photo))
    decoder.show(shown(photo))
    networks = Sam2Networks(encoder, decoder)
    encoded = networks.encode(photo)
    networks.masks_from_boxes(encoded, np.array([[0.0, 0, 256, 512], [64, 128, 128, 256]]))
    networks.masks_from_points(
        encoded, np.array([[0.0, 0.0]]), np.array([[255.0, 511.0]]), np.array([0.0, 256, 256, 512])
    )
    return fed


def test_files_of_transformers_js_get_prompts_in_their_layout(stand_in_network, shown):
    """Boxes are boxes, beside no points at all; points come in a box, for without one the answer is
    left to chance.
    """

    def answer(feed):
        n = max(feed["input_boxes"].shape[1], 1)
        return {"iou_scores": np.zeros((1, n, 3)), "pred_masks": np.zeros((1, n, 3, 256, 256))}

    box, point = prompts_fed("transformers.js", answer, stand_in_network, shown)
    assert box["input_points"].shape == (1, 2, 0, 2)
    assert box["input_labels"].shape == (1, 2, 0)
    assert box["input_labels"].dtype == np.int64
    # The centres of the first and of the last pixel: 4 px of the square a pixel across, 2 down.
    assert box["input_boxes"][0].tolist() == [
        [1.5, 0.5, 1021.5, 1022.5],
        [257.5, 256.5, 509.5, 510.5],
    ]
    assert point["input_boxes"].tolist() == [[[1.5, 512.5, 1021.5, 1022.5]]]
    assert point["input_points"].tolist() == [[[[1.5, 0.5], [1021.5, 1022.5]]]]
    assert point["input_labels"].tolist() == [[[1, 0]]]


def test_providers_without_empty_arrays_get_a_padding_point(stand_in_network, shown):
    encoder, decoder = networks_of(
        "transformers.js",
        stand_in_network,
        lambda shown, feed: {
            "iou_scores": np.zeros((1, 1, 3)),
            "pred_masks": np.zeros((1, 1, 3, 256, 256)),
        },
    )
    photo = np.zeros((20, 20, 3), np.uint8)
    encoder.show(shown(photo))
    decoder.show(shown(photo))
    decoder.provider = "CoreML"
    networks = Sam2Networks(encoder, decoder)
    networks.masks_from_boxes(networks.encode(photo), np.array([[0.0, 0, 10, 10]]))
    assert decoder.fed["input_points"].shape == (1, 1, 1, 2)
    assert decoder.fed["input_labels"].tolist() == [[[-1]]]


def test_files_of_samexporter_get_prompts_in_their_layout(stand_in_network, shown):
    """A box is two points, labelled 2 and 3, and others come after them; labels are floats."""

    def answer(feed):
        n = len(feed["point_coords"])
        return {"iou_predictions": np.zeros((n, 3)), "masks": np.zeros((n, 3, 256, 256))}

    box, point = prompts_fed("samexporter", answer, stand_in_network, shown)
    assert box["point_coords"][0].tolist() == [[1.5, 0.5], [1021.5, 1022.5]]
    assert box["point_labels"].tolist() == [[2, 3], [2, 3]]
    assert box["point_labels"].dtype == np.float32
    assert box["mask_input"].shape == (2, 1, 256, 256)
    assert box["has_mask_input"].tolist() == [0]
    assert point["point_coords"].tolist() == [
        [[1.5, 512.5], [1021.5, 1022.5], [1.5, 0.5], [1021.5, 1022.5]]
    ]
    assert point["point_labels"].tolist() == [[2, 3, 1, 0]]


def test_halves_of_two_exports_are_refused(stand_in_network):
    encoder, _ = networks_of("transformers.js", stand_in_network)
    _, decoder = networks_of("samexporter", stand_in_network)
    with pytest.raises(BackendError, match=r"transformers\.js .* stand_in\.onnx"):
        Sam2Networks(encoder, decoder)


def test_files_are_found_by_their_names(tmp_path):
    (tmp_path / "onnx").mkdir()
    for name in (
        "vision_encoder",
        "vision_encoder_fp16",
        "prompt_encoder_mask_decoder",
        "prompt_encoder_mask_decoder_q4",
    ):
        (tmp_path / "onnx" / f"{name}.onnx").write_bytes(b"x")
    assert [p.stem for p in find_sam2_files(tmp_path)] == [
        "vision_encoder",
        "prompt_encoder_mask_decoder",
    ]
    assert find_sam2_files(tmp_path, "fp16")[0].stem == "vision_encoder_fp16"
    with pytest.raises(BackendError, match="has not an encoder _q8"):
        find_sam2_files(tmp_path, "q8")


def standing(boxes, size=(200, 300), keypoints=None):
    masks = np.zeros((len(boxes), *size), bool)
    for mask, (x0, y0, x1, y1) in zip(masks, boxes, strict=True):
        mask[y0:y1, x0:x1] = True
    return People(
        masks, np.array(boxes, float).reshape(-1, 4), np.full(len(boxes), 0.9), None, keypoints
    )


def test_feet_are_the_lower_ends_of_people_who_are_not_cut_off():
    """Not of those who are cut off by the photo's edge, nor of those who are wider than a standing
    person.
    """
    feet = feet_positions(standing([(20, 20, 60, 160)]))
    assert feet == pytest.approx(np.array([[39.5, 159, 20]]))
    assert not len(feet_positions(standing([(20, 60, 60, 200)])))
    assert not len(feet_positions(standing([(20, 100, 100, 160)])))


def test_if_most_people_are_cut_off_no_feet_are_used():
    assert not len(
        feet_positions(standing([(20, 20, 60, 160), (80, 60, 120, 200), (140, 60, 180, 200)]))
    )


def test_feet_are_ankles_where_they_are_known():
    points = np.zeros((1, 17, 2))
    points[0, [13, 14]], points[0, [15, 16]] = (40, 100), (40, 140)
    sure = np.zeros((1, 17))
    sure[0, 15] = 0.9
    people = standing([(20, 20, 60, 200)], keypoints=Keypoints(points, sure, "coco17"))
    assert feet_positions(people)[:, :2] == pytest.approx(np.array([[40, 146]]))


def test_points_of_the_ground_are_outside_people_and_inside_the_photo():
    people = standing([(20, 20, 60, 190), (70, 20, 110, 190)])
    points = ground_points(people)
    assert len(points)
    x, y = np.rint(points).astype(int).T
    assert not people.masks.any(0)[y, x].any()


# A detector, an encoder and a decoder that know the world which is shown.


def rt_detr(stand_in_network, joints=False):
    def answer(shown, feed):
        logits = np.full((1, 300, 80), -9.0)
        boxes = np.full((1, 300, 4), 0.5)
        height, width = shown.photo.shape[:2]
        for i, (x0, y0, x1, y1) in enumerate(true_boxes(shown)):
            logits[0, 3 * i, 0] = 3 - 0.1 * i
            boxes[0, 3 * i] = (
                (x0 + x1) / 2 / width,
                (y0 + y1) / 2 / height,
                (x1 - x0) / width,
                (y1 - y0) / height,
            )
        return {"logits": logits, "pred_boxes": boxes}

    ports = {"logits": ("float32", ("b", 300, 80)), "pred_boxes": ("float32", ("b", 300, 4))}
    return stand_in_network({"pixel_values": ("float32", ("b", 3, 640, 640))}, ports, answer)


def rtmo(stand_in_network):
    def answer(shown, feed):
        scale = 640 / max(shown.photo.shape[:2])
        boxes = true_boxes(shown) * scale
        joints = np.zeros((1, len(boxes), 17, 3))
        if shown.world is not None and shown.people:
            joints[0, ..., :2] = (shown.world.keypoints["coco17"] + 0.5) * scale
            joints[0, ..., 2] = np.where(shown.world.visible["coco17"], 0.9, 0.1)
        scores = np.linspace(0.9, 0.8, len(boxes))[:, None]
        return {"dets": np.concatenate([boxes, scores], 1)[None], "keypoints": joints}

    ports = {"dets": ("float32", ("b", "n", 5)), "keypoints": ("float32", ("b", "n", 17, 3))}
    return stand_in_network({"input": ("float32", ("b", 3, 640, 640))}, ports, answer)


def yolox(stand_in_network):
    cells = [(s, x, y) for s in (8, 16, 32) for y in range(640 // s) for x in range(640 // s)]

    def answer(shown, feed):
        scale = 640 / max(shown.photo.shape[:2])
        output = np.zeros((1, len(cells), 85))
        for i, (x0, y0, x1, y1) in enumerate(true_boxes(shown) * scale):
            cx = (x0 + x1) / 2
            cy = (y0 + y1) / 2
            cell = cells.index((16, int(cx // 16), int(cy // 16)))
            sides = np.log([(x1 - x0) / 16, (y1 - y0) / 16])
            output[0, cell, :6] = (
                cx / 16 - cx // 16,
                cy / 16 - cy // 16,
                *sides,
                0.95,
                0.95 - 0.02 * i,
            )
        return {"output": output}

    port = {"images": ("float32", (1, 3, 640, 640))}
    return stand_in_network(port, {"output": ("float32", (1, len(cells), 85))}, answer)


def true_boxes(shown):
    if shown.world is None:  # something in the middle of a photo of which nothing is known
        height, width = shown.photo.shape[:2]
        return np.array([[0.4 * width, 0.2 * height, 0.6 * width, 0.9 * height]])
    return shown.world.boxes if shown.people else np.zeros((0, 4))


def squashed(mask):
    """A mask of the photo as logits of the square, by torch's area resampling."""
    share = torch.nn.functional.interpolate(
        torch.tensor(mask, dtype=torch.float32)[None, None], (256, 256), mode="area"
    )
    return 20 * share[0, 0].numpy() - 10


def thing_in(shown, box):
    """The person whose box it is; an ellipse in it where nobody is known."""
    height, width = shown.photo.shape[:2]
    box = np.asarray(box) * np.array([width, height, width, height]) / 1024
    if shown.world is None:
        y, x = np.mgrid[:height, :width]
        inside = ((x - box[[0, 2]].mean()) / (box[2] - box[0] + 1)) ** 2
        return squashed(inside + ((y - box[[1, 3]].mean()) / (box[3] - box[1] + 1)) ** 2 < 0.25)
    off = np.abs(shown.world.boxes - box).sum(axis=1)
    return squashed(shown.world.masks[off.argmin()])


def thing_at(shown, points, labels):
    """The floor if most of the points lie on it; nothing else is known."""
    height, width = shown.photo.shape[:2]
    if shown.world is None:
        return np.full((256, 256), -10.0)
    x, y = ((points[labels == 1] + 0.5) * [width, height] / 1024).astype(int).T
    on_floor = shown.world.floor_mask[y.clip(0, height - 1), x.clip(0, width - 1)].mean() > 0.5
    return squashed(shown.world.floor_mask) if on_floor else np.full((256, 256), -10.0)


def of_three(logits):
    """Beside the right one a half of it and everything, which the network believes less."""
    part = logits.copy()
    part[: 256 // 2] = -10
    return np.stack([part, np.full_like(logits, 10), logits]), np.array([0.6, 0.3, 0.95])


def decode(signature):
    def answer(shown, feed):
        if signature == "transformers.js":
            prompts = [(box, None) for box in feed["input_boxes"][0]]
            if feed["input_points"].shape[2]:
                prompts = [(None, (feed["input_points"][0, 0], feed["input_labels"][0, 0]))]
        else:
            prompts = [
                (points.ravel(), None)
                if labels.tolist() == [2, 3]
                else (None, (points[2:], labels[2:]))
                for points, labels in zip(feed["point_coords"], feed["point_labels"], strict=True)
            ]
        answers = [
            of_three(thing_in(shown, b) if b is not None else thing_at(shown, *p))
            for b, p in prompts
        ]
        masks, fits = (np.stack(part) for part in zip(*answers, strict=True))
        if signature == "transformers.js":
            return {"pred_masks": masks[None], "iou_scores": fits[None]}
        return {"masks": masks, "iou_predictions": fits}

    return answer


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """The library's own class, small and random, exported as transformers.js's files are."""
    transformers = pytest.importorskip("transformers")
    torch.manual_seed(0)
    backbone = {
        "model_type": "sam2_hiera_det_model", "hidden_size": 16, "num_attention_heads": 1,
        "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [16, 32, 64, 128],
        "num_attention_heads_per_stage": [1, 2, 4, 8], "global_attention_blocks": [3],
    }  # fmt: skip
    vision = {"backbone_config": backbone, "backbone_channel_list": [128, 64, 32, 16]}
    model = transformers.Sam2Model(transformers.Sam2Config(vision_config=vision)).eval()

    class Encoder(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.model = model

        def forward(self, pixel_values):
            return tuple(self.model.get_image_embeddings(pixel_values))

    class Decoder(Encoder):
        def forward(self, points, labels, boxes, *embeddings):
            answer = self.model(
                image_embeddings=list(embeddings), input_points=points, input_labels=labels, input_boxes=boxes,  # noqa: E501
                multimask_output=True,
            )  # fmt: skip
            return answer.iou_scores, answer.pred_masks, answer.object_score_logits

    folder = tmp_path_factory.mktemp("real")
    inputs, outputs = DECODER["transformers.js"]
    free = {
        "input_points": {1: "n", 2: "p"},
        "input_labels": {1: "n", 2: "p"},
        "input_boxes": {1: "boxes"},
    }
    example = (
        torch.zeros(1, 2, 1, 2),
        -torch.ones(1, 2, 1, dtype=torch.int64),
        torch.ones(1, 2, 4),
    )
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")
        picture = torch.zeros(1, 3, 1024, 1024)
        embeddings = tuple(model.get_image_embeddings(picture))
        torch.onnx.export(
            Encoder(), (picture,), str(folder / "vision_encoder.onnx"), input_names=["pixel_values"],  # noqa: E501
            output_names=list(FEATURES["transformers.js"]), opset_version=17, dynamo=False,
        )  # fmt: skip
        torch.onnx.export(
            Decoder(), (*example, *embeddings), str(folder / "prompt_encoder_mask_decoder.onnx"),
            input_names=list(inputs), output_names=list(outputs), opset_version=17, dynamo=False,
            dynamic_axes=free | {name: {1: "n"} for name in outputs},
        )  # fmt: skip
    return model, folder


def test_files_of_segmenter_and_detector_are_loaded(real, constant_graph, tmp_path):
    found = np.array([[[40.0, 60, 200, 290, 0.9], [250, 30, 330, 310, 0.8]]])
    frame = {"input": ("float32", ("b", 3, 640, 640))}
    detector = constant_graph(tmp_path / "detector.onnx", frame, dets=found)
    options = Sam2Options(weights=str(real[1]), detector=str(detector), floor="none", threads=1)
    backend = Sam2(options)
    assert backend.missing() == ()
    backend.load()
    people = backend.infer(np.zeros((320, 640, 3), np.uint8))
    assert people.floor is None
    assert set(people.scores.round(1).tolist()) <= {0.9, 0.8}


@pytest.mark.slow
def test_the_real_class_answers_boxes_the_same(real):
    """The picture, the prompt and the network: against the library's class, asked with boxes as its
    users ask.
    """
    model, folder = real
    networks = open_sam2(folder, OnnxOptions(threads=1), "cpu")
    photo = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    boxes = np.array([[4.0, 6, 30, 40], [20, 3, 60, 47]])
    encoded = networks.encode(photo)
    logits, fits = networks.masks_from_boxes(encoded, boxes)
    ends = [encoded.to_input_pixels(boxes[:, :2]), encoded.to_input_pixels(boxes[:, 2:] - 1)]
    corners = np.stack(ends, 1).reshape(1, 2, 4)
    with torch.no_grad():
        theirs = model(
            image_embeddings=[torch.tensor(f) for f in encoded.features],
            input_boxes=torch.tensor(corners, dtype=torch.float32),
            multimask_output=True,
        )
    assert logits == pytest.approx(theirs.pred_masks[0].numpy(), abs=1e-6)
    assert fits == pytest.approx(theirs.iou_scores[0].numpy(), abs=1e-6)


def test_the_real_class_answers_points_in_a_box_the_same(real):
    model, folder = real
    networks = open_sam2(folder, OnnxOptions(threads=1), "cpu")
    encoded = networks.encode(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))
    inside = np.array([[10.0, 20], [30, 40]])
    outside = np.array([[50.0, 5]])
    logits, fits = networks.masks_from_points(encoded, inside, outside, np.array([0.0, 10, 64, 48]))
    points = encoded.to_input_pixels(np.concatenate([inside, outside]))
    corners = encoded.to_input_pixels(np.array([[0.0, 10], [63, 47]])).reshape(1, 1, 4)
    with torch.no_grad():
        theirs = model(
            image_embeddings=[torch.tensor(f) for f in encoded.features],
            input_points=torch.tensor(points[None, None], dtype=torch.float32),
            input_labels=torch.tensor([[[1, 1, 0]]]),
            input_boxes=torch.tensor(corners, dtype=torch.float32),
            multimask_output=True,
        )
    assert logits == pytest.approx(theirs.pred_masks[0, 0].numpy(), abs=1e-6)
    assert fits == pytest.approx(theirs.iou_scores[0, 0].numpy(), abs=1e-6)


@pytest.fixture(scope="module")
def sam2(stand_in, stand_in_network):
    def make(signature, detector):
        def attach(backend):
            encoder, decoder = networks_of(signature, stand_in_network, decode(signature))
            seer = detector(stand_in_network)
            backend.encoder = encoder
            return (Sam2Networks(encoder, decoder), Detector(seer)), encoder, decoder, seer

        return stand_in(Sam2, attach)

    return make


@pytest.mark.slow
@pytest.mark.parametrize(
    ("signature", "detector"),
    [("transformers.js", rt_detr), ("samexporter", yolox), ("samexporter", rtmo)],
)
def test_conformance(sam2, signature, detector):
    # The network's masks have 256 x 256 cells, each of more than a pixel in these photos.
    report = check_backend(sam2(signature, detector), exact_limits={"IoU": 0.97})
    report.raise_if_failed()
    print(report.text)


@pytest.mark.parametrize("detector", [rt_detr, rtmo])
def test_people_and_floor_of_a_world(sam2, detector):
    """The network's own grid is what is lost: 256 cells across."""
    world = load_world("stand_indoors", (320, 240))
    backend = sam2("transformers.js", detector)()
    backend.load()
    people = backend.infer(world.image)
    assert backend.encoder.runs == 1, "one encoding serves the people and the floor"
    (mask,) = people.masks
    assert (mask & world.masks[0]).sum() / (mask | world.masks[0]).sum() > 0.93
    assert people.floor is not None
    assert (people.floor & world.floor_mask).sum() / (people.floor | world.floor_mask).sum() > 0.9
    assert (people.keypoints is not None) == (detector is rtmo)
    if people.keypoints is not None:
        assert people.keypoints.points == pytest.approx(world.keypoints["coco17"], abs=1e-3)


def test_no_people_need_no_encoding(sam2):
    backend = sam2("transformers.js", rt_detr)()
    backend.load()
    people = backend.infer(load_world("stand_indoors", (320, 240)).empty_image)
    assert len(people) == 0
    assert people.floor is None
    assert backend.encoder.runs == 0
