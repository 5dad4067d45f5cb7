"""SAM 2 in both of its signatures."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import torch

from physic_core.errors import BackendError
from physic_core.types import Keypoints, People
from physic_onnx.sam2 import Sam2, Sam2Options
from physic_onnx.sam2_floor import feet_positions
from physic_onnx.sam2_networks import Sam2Networks, find_sam2_files, open_sam2
from physic_onnx.sessions import OnnxOptions

from .pose_worlds import KnownBoxes

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
    def encode(feed):
        return {
            name: np.zeros(shape, np.float32)
            for name, shape in zip(FEATURES[signature], MAPS, strict=True)
        }

    encoder = stand_in_network(*(encoder_ports or ENCODER[signature]), encode)
    return encoder, stand_in_network(*DECODER[signature], answer or (lambda feed: {}))


def test_the_tracker_of_sam_3_gets_values_from_minus_1_to_1(stand_in_network):
    ports = ({"pixel_values": ("float32", (1, 3, 1008, 1008))}, ENCODER["transformers.js"][1])
    encoder, decoder = networks_of("transformers.js", stand_in_network, encoder_ports=ports)
    photo = np.full((30, 40, 3), 255, np.uint8)
    Sam2Networks(encoder, decoder).encode(photo)
    assert encoder.fed["pixel_values"] == pytest.approx(1.0)


def prompts_fed(signature, answer, stand_in_network):
    """What the decoder is fed for two boxes, and for a point inside and one outside, of a photo of
    256 x 512 px.
    """
    fed = []

    def record(feed):
        fed.append(feed)
        return answer(feed)

    encoder, decoder = networks_of(signature, stand_in_network, record)
    photo = np.zeros((512, 256, 3), np.uint8)
    networks = Sam2Networks(encoder, decoder)
    encoded = networks.encode(photo)
    networks.masks_from_boxes(encoded, np.array([[0.0, 0, 256, 512], [64, 128, 128, 256]]))
    networks.masks_from_points(
        encoded, np.array([[0.0, 0.0]]), np.array([[255.0, 511.0]]), np.array([0.0, 256, 256, 512])
    )
    return fed


def test_files_of_transformers_js_get_prompts_in_their_layout(stand_in_network):
    """Boxes are boxes, beside no points at all; points come in a box, for without one the answer is
    left to chance.
    """

    def answer(feed):
        n = max(feed["input_boxes"].shape[1], 1)
        return {"iou_scores": np.zeros((1, n, 3)), "pred_masks": np.zeros((1, n, 3, 256, 256))}

    box, point = prompts_fed("transformers.js", answer, stand_in_network)
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


def test_providers_without_empty_arrays_get_a_padding_point(stand_in_network):
    encoder, decoder = networks_of(
        "transformers.js",
        stand_in_network,
        lambda feed: {
            "iou_scores": np.zeros((1, 1, 3)),
            "pred_masks": np.zeros((1, 1, 3, 256, 256)),
        },
    )
    photo = np.zeros((20, 20, 3), np.uint8)
    decoder.provider = "CoreML"
    networks = Sam2Networks(encoder, decoder)
    networks.masks_from_boxes(networks.encode(photo), np.array([[0.0, 0, 10, 10]]))
    assert decoder.fed["input_points"].shape == (1, 1, 1, 2)
    assert decoder.fed["input_labels"].tolist() == [[[-1]]]


def test_files_of_samexporter_get_prompts_in_their_layout(stand_in_network):
    """A box is two points, labelled 2 and 3, and others come after them; labels are floats."""

    def answer(feed):
        n = len(feed["point_coords"])
        return {"iou_predictions": np.zeros((n, 3)), "masks": np.zeros((n, 3, 256, 256))}

    box, point = prompts_fed("samexporter", answer, stand_in_network)
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


def test_feet_are_ankles_where_they_are_known():
    points = np.zeros((1, 17, 2))
    points[0, [13, 14]] = (40, 100)
    points[0, [15, 16]] = (40, 140)
    sure = np.zeros((1, 17))
    sure[0, 15] = 0.9
    people = standing([(20, 20, 60, 200)], keypoints=Keypoints(points, sure, "coco17"))
    assert feet_positions(people)[:, :2] == pytest.approx(np.array([[40, 146]]))


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


def test_files_of_segmenter_and_detector_are_loaded(constant_graph, tmp_path):
    weights = tmp_path / "weights"
    inputs, outputs = ENCODER["transformers.js"]
    maps = {name: np.zeros(shape) for name, (_, shape) in outputs.items()}
    constant_graph(weights / "vision_encoder.onnx", inputs, **maps)
    masks = np.full((1, 2, 3, 256, 256), -10.0)
    masks[:, 0, :, :, :90] = masks[:, 1, :, :, 90:140] = 10
    constant_graph(
        weights / "prompt_encoder_mask_decoder.onnx",
        DECODER["transformers.js"][0],
        iou_scores=np.zeros((1, 2, 3)),
        pred_masks=masks,
        object_score_logits=np.zeros((1, 2, 1)),
    )
    found = np.array([[[40.0, 60, 200, 290, 0.9], [250, 30, 330, 310, 0.8]]])
    frame = {"input": ("float32", ("b", 3, 640, 640))}
    detector = constant_graph(tmp_path / "detector.onnx", frame, dets=found)
    options = Sam2Options(weights=str(weights), detector=str(detector), floor="none", threads=1)
    backend = Sam2(options)
    assert backend.missing() == ()
    assert backend.fingerprint()
    backend.load()
    people = backend.infer(np.zeros((320, 640, 3), np.uint8))
    assert people.floor is None
    assert people.scores.round(1).tolist() == [0.9, 0.8]
    backend.close()
    (weights / "vision_encoder.onnx").unlink()
    assert backend.missing()
    with pytest.raises(BackendError, match="in a folder"):
        Sam2(options.model_copy(update={"weights": str(detector)})).load()


@pytest.mark.slow
def test_the_real_class_answers_boxes_and_points_the_same(real):
    """The picture, the prompt and the network: against the library's class, asked as its users
    ask.
    """
    model, folder = real
    networks = open_sam2(folder, OnnxOptions(threads=1), "cpu")
    encoded = networks.encode(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))

    def theirs(boxes, **points):
        ends = [encoded.to_input_pixels(boxes[:, :2]), encoded.to_input_pixels(boxes[:, 2:] - 1)]
        corners = torch.tensor(np.stack(ends, 1).reshape(1, -1, 4), dtype=torch.float32)
        with torch.no_grad():
            answer = model(
                image_embeddings=[torch.tensor(f) for f in encoded.features],
                input_boxes=corners,
                multimask_output=True,
                **points,
            )
        return answer.pred_masks[0].numpy(), answer.iou_scores[0].numpy()

    boxes = np.array([[4.0, 6, 30, 40], [20, 3, 60, 47]])
    for ours, own in zip(networks.masks_from_boxes(encoded, boxes), theirs(boxes), strict=True):
        assert ours == pytest.approx(own, abs=1e-6)
    inside = np.array([[10.0, 20], [30, 40]])
    outside = np.array([[50.0, 5]])
    box = np.array([0.0, 10, 64, 48])
    points = encoded.to_input_pixels(np.concatenate([inside, outside]))[None, None]
    prompt = {
        "input_points": torch.tensor(points, dtype=torch.float32),
        "input_labels": torch.tensor([[[1, 1, 0]]]),
    }
    found = networks.masks_from_points(encoded, inside, outside, box)
    for ours, own in zip(found, theirs(box[None], **prompt), strict=True):
        assert ours == pytest.approx(own[0], abs=1e-6)


def rectangles(feed):
    """Three masks for each box, of which the best is its lower half; points get the lowest rows."""
    y, x = np.mgrid[:256, :256] * 4 + 2
    masks = []
    for x0, y0, x1, y1 in feed["input_boxes"][0]:
        inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        whole = np.ones((256, 256), bool)
        best = y > 900 if feed["input_points"].shape[2] else inside & (y > (y0 + y1) / 2)
        masks.append([whole, inside, best])
    fits = np.tile([0.6, 0.3, 0.95], (1, len(masks), 1))
    return {"pred_masks": 20.0 * np.array(masks)[None] - 10, "iou_scores": fits}


@pytest.mark.parametrize("people", [0, 2])
def test_people_are_the_best_masks_in_their_boxes_and_one_encoding_serves_the_floor(
    stand_in_network, people
):
    boxes = [(10.0, 20, 50, 180), (60.0, 20, 100, 180)][:people]
    encoder, decoder = networks_of("transformers.js", stand_in_network, rectangles)
    backend = Sam2(Sam2Options())
    backend._network = Sam2Networks(encoder, decoder), KnownBoxes(boxes)
    found = backend.infer(np.zeros((200, 120, 3), np.uint8))
    assert encoder.runs == min(people, 1)
    assert len(found) == people
    for mask, (x0, y0, x1, y1) in zip(found.masks, boxes, strict=True):
        rows, columns = np.nonzero(mask)
        edges = [columns.min(), rows.min(), columns.max(), rows.max()]
        assert edges == pytest.approx([x0, (y0 + y1) / 2, x1, y1], abs=2)
    assert (found.floor is None) == (people == 0)
    if people:
        assert found.floor[185:].all()
        assert not found.floor[:170].any()
