"""ViTPose's class in transformers with random weights, exported as published files are, against its
own pipeline.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from physic_core.types import People
from physic_onnx.vitpose import HUB, PLUS, VitPose

from .pose_worlds import region


@pytest.fixture(params=[1, 3], ids=["plain", "plus"])
def network(request, tmp_path):
    """A small network of one or more experts, and its file."""
    import torch

    pytest.importorskip("transformers")
    from transformers import VitPoseBackboneConfig, VitPoseConfig, VitPoseForPoseEstimation

    experts = request.param
    torch.manual_seed(0)
    backbone = VitPoseBackboneConfig(
        image_size=[256, 192], patch_size=[16, 16], hidden_size=16, num_hidden_layers=2, num_attention_heads=2,  # noqa: E501
        mlp_ratio=2, num_experts=experts, part_features=4 if experts > 1 else 0, out_indices=[2],
    )  # fmt: skip
    model = VitPoseForPoseEstimation(VitPoseConfig(backbone_config=backbone, num_labels=17)).eval()
    inputs = {"pixel_values": torch.rand(2, 3, 256, 192)}
    if experts > 1:
        inputs["dataset_index"] = torch.zeros(2, dtype=torch.int64)

    class Graph(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.model = model

        def forward(self, *values):
            return self.model(**dict(zip(inputs, values, strict=True))).heatmaps

    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Graph().eval(),
            tuple(inputs.values()),
            str(tmp_path / "model.onnx"),
            input_names=list(inputs),
            output_names=["heatmaps"],
            dynamic_axes={name: {0: "batch"} for name in (*inputs, "heatmaps")},
            opset_version=17,
            dynamo=False,
        )
    return model, tmp_path / "model.onnx", experts > 1


def test_the_exported_class_answers_as_transformers_own_pipeline(network, loaded):
    import torch
    from scipy.ndimage import gaussian_filter
    from transformers.models.vitpose.image_processing_pil_vitpose import VitPoseImageProcessorPil

    model, path, plus = network
    noise = np.random.default_rng(0).uniform(0, 255, (400, 420, 3))
    image = np.clip(gaussian_filter(noise, (3, 3, 0)) * 8 - 900, 0, 255).astype(np.uint8)
    # Crops lie inside the photo: at its edge OpenCV blends with what is outside, and SciPy does
    # not.
    boxes = np.array(
        [[110.0, 90.0, 200.0, 250.0], [100.0, 110.0, 260.0, 230.0], [150.0, 80.0, 210.0, 250.0]]
    )
    backend = loaded(VitPose, path)
    assert backend.network.signature == (PLUS if plus else HUB)
    found = backend.infer(image, People(np.zeros((3, 400, 420), bool), boxes, np.ones(3)))

    # Their boxes are x y w h in coordinates whose integers are pixels' edges.
    theirs = [[x0 - 0.5, y0 - 0.5, x1 - x0, y1 - y0] for x0, y0, x1, y1 in boxes]
    processor = VitPoseImageProcessorPil()
    pictures = processor(image, boxes=[theirs], return_tensors="pt")["pixel_values"]
    index = {"dataset_index": torch.zeros(3, dtype=torch.int64)} if plus else {}
    with torch.no_grad():
        outputs = model(pixel_values=pictures.float(), **index)
    answers = processor.post_process_pose_estimation(outputs, boxes=[theirs])[0]
    maps = outputs.heatmaps.numpy()
    same = 0
    for row, (answer, box) in enumerate(zip(answers, boxes, strict=True)):
        score = answer["scores"].numpy()
        assert np.allclose(found.confidence[row], np.clip(score, 0, 1), atol=2e-3)
        centre, size = region(box, 192, 256)
        cell = size / [47, 63]
        highest = maps[row].reshape(17, -1).argmax(1)
        start = np.stack([highest % 48, highest // 48], -1) * cell + centre - size / 2
        step = np.abs(answer["keypoints"].numpy() - start) / cell
        apart = np.abs(found.points[row] - answer["keypoints"].numpy()) / cell
        # Where a map is flat, theirs goes off by cells or tens of them; ours stays.
        tame = (step <= 1).all(1) & (score > 0)
        assert (np.abs(found.points[row] - start) / cell).max() <= 1.001
        assert np.quantile(apart[tame], 0.9) < 0.02
        same += tame.sum()
    assert same > 40
