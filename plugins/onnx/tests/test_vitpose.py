"""ViTPose: both forms of the file, colours, and the grid of its heat maps."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from physic_core.errors import BackendError
from physic_core.interfaces import KeypointDetector
from physic_core.types import People
from physic_onnx.vitpose import HUB, PLUS, VitPose
from physic_testing import violations

from .pose_worlds import BOX, blobs, people, region

PORTS = {
    "easy": ("input_0", "output_0"),
    "hub": ("pixel_values", "heatmaps"),
    "plus": ("pixel_values", "heatmaps"),
}


@pytest.fixture
def vitpose(bound, stand_in_network):
    """A network whose joint j is the colour j mod 3 of what it is shown, on the grid that such a
    network is trained on; one of experts adds the number of its expert.

    COCO's 17 joints: first and last cell are first and last pixel (UDP). All others: cell q is
    pixel 4 q.
    """

    def make(kind="easy", count=17, *, stated=True):
        picture, maps = PORTS[kind]
        inputs = {picture: ("float32", ("batch", 3, 256, 192))}
        if kind == "plus":
            inputs["dataset_index"] = ("int64", ("batch",))

        def answer(feed):
            seen = torch.from_numpy(feed[picture][:, np.arange(count) % 3])
            small = seen[..., ::4, ::4]
            if count == 17:
                small = torch.nn.functional.interpolate(
                    seen, (64, 48), mode="bilinear", align_corners=True
                )
            expert = feed.get("dataset_index", np.zeros(1))
            return {maps: small.numpy() + expert[:, None, None, None]}

        outputs = {maps: ("float32", ("batch", count if stated else "joints", 64, 48))}
        return bound(VitPose, stand_in_network(inputs, answer, outputs))

    return make


@pytest.mark.parametrize(
    ("kind", "count", "skeleton", "stated"),
    [
        ("easy", 17, "coco17", True),
        ("hub", 26, "halpe26", False),
        ("plus", 133, "coco_wholebody133", True),
    ],
)
def test_each_joint_set_is_read_on_the_grid_that_it_was_trained_on(
    vitpose, kind, count, skeleton, stated
):
    box = (300.0, 60.0, 560.0, 700.0)
    backend = vitpose(kind, count, stated=stated)
    for places in (
        [(430.0, 80.0), (320.0, 250.0), (540.0, 690.0)],
        [(540.0, 380.0), (430.0, 360.0), (320.0, 640.0)],
    ):
        found = backend.infer(blobs(places, (760, 900), sigma=30.0), people(box, size=(760, 900)))
        assert violations(KeypointDetector, found, people=1) == []
        assert found.skeleton == skeleton
        # red for blue is 90 px off; read on the other grid, a foot is 10 px off
        assert np.linalg.norm(found.points[0, :3] - places, axis=1).max() < 1.0


@pytest.mark.parametrize(("count", "expert"), [(17, 0), (133, 5)])
def test_vitpose_plus_gets_the_expert_of_its_joint_set(vitpose, count, expert):
    black = np.zeros((200, 260, 3), np.uint8)  # -2.1 to -1.8 after the normalisation
    assert (vitpose("plus", count).infer(black, people(BOX)).confidence == min(expert, 1)).all()


@pytest.mark.parametrize("stated", [True, False])
def test_keypoints_of_one_hand_are_refused(vitpose, stated):
    with pytest.raises(BackendError, match=r"returns 21 keypoints a person.*those of one hand"):
        vitpose(count=21, stated=stated)


@pytest.fixture(params=[1, 3], ids=["plain", "plus"])
def model(request):
    """The class in transformers, small and of random weights, of one or more experts."""
    pytest.importorskip("transformers")
    from transformers import VitPoseBackboneConfig, VitPoseConfig, VitPoseForPoseEstimation

    experts = request.param
    torch.manual_seed(0)
    backbone = VitPoseBackboneConfig(
        image_size=[256, 192], patch_size=[16, 16], hidden_size=16, num_hidden_layers=2, num_attention_heads=2,  # noqa: E501
        mlp_ratio=2, num_experts=experts, part_features=4 if experts > 1 else 0, out_indices=[2],
    )  # fmt: skip
    return VitPoseForPoseEstimation(VitPoseConfig(backbone_config=backbone, num_labels=17)).eval()


def test_the_librarys_class_answers_as_in_its_own_pipeline(model, bound, stand_in_network):
    from transformers.models.vitpose.image_processing_pil_vitpose import VitPoseImageProcessorPil

    plus = model.config.backbone_config.num_experts > 1
    inputs = {"pixel_values": ("float32", ("batch", 3, 256, 192))}
    if plus:
        inputs["dataset_index"] = ("int64", ("batch",))

    @torch.no_grad()
    def answer(feed):
        given = {name: torch.from_numpy(value) for name, value in feed.items()}
        return {"heatmaps": model(**given).heatmaps.numpy()}

    outputs = {"heatmaps": ("float32", ("batch", 17, 64, 48))}
    backend = bound(VitPose, stand_in_network(inputs, answer, outputs))
    assert backend.network.signature == (PLUS if plus else HUB)
    noise = np.random.default_rng(0).uniform(0, 255, (400, 420, 3))
    image = np.clip(gaussian_filter(noise, (3, 3, 0)) * 8 - 900, 0, 255).astype(np.uint8)
    # Crops lie inside the photo: at its edge OpenCV blends with what is outside, and SciPy does
    # not.
    boxes = np.array(
        [[110.0, 90.0, 200.0, 250.0], [100.0, 110.0, 260.0, 230.0], [150.0, 80.0, 210.0, 250.0]]
    )
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
    for row, (own, box) in enumerate(zip(answers, boxes, strict=True)):
        score = own["scores"].numpy()
        assert np.allclose(found.confidence[row], np.clip(score, 0, 1), atol=2e-3)
        centre, size = region(box, 192, 256)
        cell = size / [47, 63]
        highest = maps[row].reshape(17, -1).argmax(1)
        start = np.stack([highest % 48, highest // 48], -1) * cell + centre - size / 2
        step = np.abs(own["keypoints"].numpy() - start) / cell
        apart = np.abs(found.points[row] - own["keypoints"].numpy()) / cell
        # Where a map is flat, theirs goes off by cells or tens of them; ours stays.
        tame = (step <= 1).all(1) & (score > 0)
        assert (np.abs(found.points[row] - start) / cell).max() <= 1.001
        assert np.quantile(apart[tame], 0.9) < 0.02
        same += tame.sum()
    assert same > 40
