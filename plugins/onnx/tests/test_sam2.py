"""SAM 2 in both of its signatures."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physic_core.errors import BackendError
from physic_core.types import People
from physic_onnx.sam2 import Sam2, Sam2Options
from physic_onnx.sam2_floor import feet_positions
from physic_onnx.sam2_networks import Sam2Networks, find_sam2_files

from .pose_worlds import KnownBoxes

CHANNELS = (32, 64, 256)
FEATURES = {
    "transformers.js": ("image_embeddings.0", "image_embeddings.1", "image_embeddings.2"),
    "samexporter": ("high_res_feats_0", "high_res_feats_1", "image_embed"),
}
PICTURE = {"transformers.js": "pixel_values", "samexporter": "image"}
PROMPT = {
    "transformers.js": {
        "input_points": ("float32", ("b", "n", "p", 2)),
        "input_labels": ("int64", ("b", "n", "p")),
        "input_boxes": ("float32", ("b", "boxes", 4)),
    },
    "samexporter": {
        "point_coords": ("float32", ("n", "p", 2)),
        "point_labels": ("float32", ("n", "p")),
        "mask_input": ("float32", ("n", 1, 256, 256)),
        "has_mask_input": ("float32", (1,)),
    },
}
ANSWER = {
    "transformers.js": {
        "iou_scores": ("float32", ("b", "n", 3)),
        "pred_masks": ("float32", ("b", "n", 3, 256, 256)),
    },
    "samexporter": {
        "masks": ("float32", ("n", "m", 256, 256)),
        "iou_predictions": ("float32", ("n", 3)),
    },
}


def features_of(signature, *sides):
    """Ports of the three maps, of any size unless sides are given."""
    return {
        name: ("float32", (1, channels, *(sides or ("h", "w"))))
        for name, channels in zip(FEATURES[signature], CHANNELS, strict=True)
    }


def maps_of(signature):
    return {name: np.zeros(size) for name, (_, size) in features_of(signature, 9, 9).items()}


@pytest.fixture
def networks_of(stand_in_network):
    """Encoder and decoder of an export; the decoder answers masks of nothing but for ``answer``."""

    def nothing(feed):
        many = max(feed.get("input_boxes", feed.get("point_coords")).shape[:2])
        mask = np.zeros((many, 3, 256, 256))
        fits = np.zeros((many, 3))
        own = {"masks": mask, "iou_predictions": fits}
        return own | {"pred_masks": mask[None], "iou_scores": fits[None]}

    def make(signature, answer=nothing, encode=None, side=1024):
        features = features_of(signature)
        picture = {PICTURE[signature]: ("float32", (1, 3, side, side))}
        return (
            stand_in_network(picture, encode or maps_of(signature), features),
            stand_in_network(PROMPT[signature] | features, answer, ANSWER[signature]),
        )

    return make


def test_the_tracker_of_sam_3_gets_values_from_minus_1_to_1(networks_of):
    encoder, decoder = networks_of("transformers.js", side=1008)
    Sam2Networks(encoder, decoder).encode(np.full((30, 40, 3), 255, np.uint8))
    assert encoder.fed["pixel_values"] == pytest.approx(1.0)


# The centres of the first and of the last pixel: 4 px of the square a pixel across, 2 down.
WHOLE = [[1.5, 0.5], [1021.5, 1022.5]]
MIDDLE = [[257.5, 256.5], [509.5, 510.5]]
LOWER = [[1.5, 512.5], [1021.5, 1022.5]]


def test_samexporters_decoder_gets_a_box_as_two_points_before_others(networks_of):
    """Two boxes, and then a point inside and one outside, of a photo of 256 x 512 px. A box is two
    points, labelled 2 and 3.
    """
    encoder, decoder = networks_of("samexporter")
    networks = Sam2Networks(encoder, decoder)
    photo = networks.encode(np.zeros((512, 256, 3), np.uint8))
    networks.masks_from_boxes(photo, np.array([[0.0, 0, 256, 512], [64, 128, 128, 256]]))
    np.testing.assert_array_equal(decoder.fed["point_coords"], [WHOLE, MIDDLE])
    np.testing.assert_array_equal(decoder.fed["point_labels"], [[2, 3], [2, 3]])
    np.testing.assert_array_equal(decoder.fed["mask_input"], np.zeros((2, 1, 256, 256)))
    np.testing.assert_array_equal(decoder.fed["has_mask_input"], [0])
    ends = np.array([[[0.0, 0.0]], [[255.0, 511.0]]])
    networks.masks_from_points(photo, *ends, np.array([0.0, 256, 256, 512]))
    np.testing.assert_array_equal(decoder.fed["point_coords"], [[*LOWER, *WHOLE]])
    np.testing.assert_array_equal(decoder.fed["point_labels"], [[2, 3, 1, 0]])


def test_providers_without_empty_arrays_get_a_padding_point(networks_of):
    encoder, decoder = networks_of("transformers.js")
    decoder.provider = "CoreML"
    networks = Sam2Networks(encoder, decoder)
    photo = networks.encode(np.zeros((20, 20, 3), np.uint8))
    networks.masks_from_boxes(photo, np.array([[0.0, 0, 10, 10]]))
    assert decoder.fed["input_points"].shape == (1, 1, 1, 2)
    assert decoder.fed["input_labels"].tolist() == [[[-1]]]


def test_halves_of_two_exports_are_refused(networks_of):
    encoder, _ = networks_of("transformers.js")
    _, decoder = networks_of("samexporter")
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


def standing(boxes, size=(200, 300)):
    masks = np.zeros((len(boxes), *size), bool)
    for mask, (x0, y0, x1, y1) in zip(masks, boxes, strict=True):
        mask[y0:y1, x0:x1] = True
    return People(masks, np.array(boxes, float).reshape(-1, 4), np.full(len(boxes), 0.9))


def test_feet_are_the_lower_ends_of_people_who_are_not_cut_off():
    """Not of those who are cut off by the photo's edge, nor of those who are wider than a standing
    person.
    """
    feet = feet_positions(standing([(20, 20, 60, 160)]))
    assert feet == pytest.approx(np.array([[39.5, 159, 20]]))
    assert not len(feet_positions(standing([(20, 60, 60, 200)])))
    assert not len(feet_positions(standing([(20, 100, 100, 160)])))


def test_the_librarys_class_answers_boxes_and_points_the_same(networks_of):
    """The picture, the prompt and the network: against the library's class, asked as its users
    ask.
    """
    transformers = pytest.importorskip("transformers")
    torch.manual_seed(0)
    backbone = {
        "model_type": "sam2_hiera_det_model", "hidden_size": 16, "num_attention_heads": 1,
        "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [16, 32, 64, 128],
        "num_attention_heads_per_stage": [1, 2, 4, 8], "global_attention_blocks": [3],
    }  # fmt: skip
    vision = {
        "backbone_config": backbone, "backbone_channel_list": [128, 64, 32, 16],
        "backbone_feature_sizes": [[64, 64], [32, 32], [16, 16]],
    }  # fmt: skip
    config = transformers.Sam2Config(
        vision_config=vision, prompt_encoder_config={"image_size": 256}
    )
    model = transformers.Sam2Model(config).eval()
    names = FEATURES["transformers.js"]

    @torch.no_grad()
    def encode(feed):
        maps = model.get_image_embeddings(torch.from_numpy(feed["pixel_values"]))
        return dict(zip(names, maps, strict=True))

    @torch.no_grad()
    def ask(features, **prompt):
        """Masks and fits of the class."""
        given = {name: torch.tensor(value) for name, value in prompt.items() if np.size(value)}
        maps = [torch.from_numpy(value) for value in features]
        found = model(image_embeddings=maps, multimask_output=True, **given)
        return found.pred_masks, found.iou_scores

    def decode(feed):
        maps = [feed.pop(name) for name in names]
        return dict(zip(("pred_masks", "iou_scores"), ask(maps, **feed), strict=True))

    networks = Sam2Networks(*networks_of("transformers.js", decode, encode, 256))
    photo = networks.encode(np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8))

    def corners(boxes):
        ends = [photo.to_input_pixels(boxes[:, :2]), photo.to_input_pixels(boxes[:, 2:] - 1)]
        return np.stack(ends, 1).reshape(1, -1, 4).astype(np.float32)

    boxes = np.array([[4.0, 6, 30, 40], [20, 3, 60, 47]])
    theirs = ask(photo.features, input_boxes=corners(boxes))
    for ours, own in zip(networks.masks_from_boxes(photo, boxes), theirs, strict=True):
        assert ours == pytest.approx(own[0].numpy(), abs=1e-6)
    inside = np.array([[10.0, 20], [30, 40]])
    outside = np.array([[50.0, 5]])
    box = np.array([0.0, 10, 64, 48])
    points = photo.to_input_pixels(np.concatenate([inside, outside]))[None, None]
    theirs = ask(
        photo.features,
        input_boxes=corners(box[None]),
        input_points=points.astype(np.float32),
        input_labels=[[[1, 1, 0]]],
    )
    found = networks.masks_from_points(photo, inside, outside, box)
    for ours, own in zip(found, theirs, strict=True):
        assert ours == pytest.approx(own[0, 0].numpy(), abs=1e-6)


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
    networks_of, people
):
    boxes = [(10.0, 20, 50, 180), (60.0, 20, 100, 180)][:people]
    encoder, decoder = networks_of("transformers.js", rectangles)
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
