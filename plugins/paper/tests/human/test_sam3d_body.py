"""SAM 3D Body: what its estimator is given, and which keypoint is which joint."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import torch

from physic_core.body.joints import JOINT_INDEX
from physic_core.errors import BackendError, DeviceError
from physic_core.types import Hints, Intrinsics, Keypoints, People
from physic_human.sam3d_body import Sam3dBody, Sam3dBodyOptions
from physic_networks.networks import TorchBackend

from .conftest import reading

CAMERA = Intrinsics(500.0, 510.0, 30.0, 20.0, 64, 48)
NUM_KEYPOINTS = Keypoints(np.zeros((2, 17, 2)), np.zeros((2, 17)), "coco17")

# As the published code is in what it fetches, reads, sends to which device, and where it puts
# bodies.
CHECKOUT = """
import pathlib
import re
import numpy as np
import torch

class Network(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.gain = torch.nn.Parameter(torch.zeros(1))
        self.head_pose = torch.nn.ModuleDict({"mhr": torch.nn.Linear(2, 2)})  # of its own file

def load_sam_3d_body(checkpoint_path="", device="cuda", mhr_path=""):
    assert pathlib.Path(mhr_path).is_file()
    print("Loading SAM 3D Body model...")
    network, text = Network(), (pathlib.Path(checkpoint_path).parent / "model_config.yaml").read_text()
    backbone = re.search("TYPE: (.*)", text)[1]
    decoder = {name: value == "true" for name, value in re.findall("(USE_INTRIN_CENTER): (.*)", text)}
    config = {"MODEL": {"BACKBONE": {"TYPE": backbone}, "DECODER": decoder}}
    if backbone.startswith("dinov3"):
        network.backbone = torch.nn.Module()
        network.backbone.encoder = torch.hub.load(
            "facebookresearch/dinov3", backbone, source="github", pretrained=False, drop_path=0.1
        )
    network.held = torch.load(checkpoint_path, map_location="cpu", weights_only=False)
    own = network.state_dict()  # numbers of other shapes are skipped too, with a warning in a log
    fits = {name: value for name, value in network.held["state_dict"].items() if own[name].shape == value.shape}
    network.load_state_dict(fits, strict=False)
    network.device = device
    return network, config

class SAM3DBodyEstimator:
    def __init__(self, sam_3d_body_model, model_cfg, human_detector=None, human_segmentor=None, fov_estimator=None):
        self.model, self.cfg = sam_3d_body_model, model_cfg
        self.faces = np.array([[0, 1, 2]])
        self.asked = []

    def process_one_image(self, img, bboxes=None, masks=None, cam_int=None, det_cat_id=0, bbox_thr=0.5, nms_thr=0.3,
                          use_mask=False):
        print("####### Please make sure the input image is in RGB format")
        height, width = img.shape[:2]
        if masks is not None:
            masks = masks.reshape(-1, height, width, 1).astype(np.uint8)
        self.asked.append((img.copy(), bboxes.copy(), masks, cam_int.clone()))
        focal, middle = cam_int[0, 0, 0].item(), np.array([width, height]) / 2
        if self.cfg["MODEL"]["DECODER"].get("USE_INTRIN_CENTER", False):
            middle = cam_int[0, :2, 2].numpy()
        return [
            {
                "pred_vertices": np.full((5, 3), 0.5, np.float32),
                "pred_cam_t": np.array([*(((box[:2] + box[2:]) / 2 - middle) / focal * 3), 3], np.float32),
                "pred_keypoints_3d": np.arange(210, dtype=np.float32).reshape(70, 3),
                "pred_keypoints_2d": np.zeros((70, 2)),
                "focal_length": 500.0,
                "shape_params": np.zeros(45),
            }
            for box in bboxes
        ]
"""  # noqa: E501

DINOV3 = {
    "hubconf.py": "import omegaconf_of_its_evaluation",
    "dinov3/__init__.py": "",
    "dinov3/hub/__init__.py": "",
    "dinov3/hub/backbones.py": """
from dinov3.models import Transformer

def dinov3_vith16plus(*, pretrained=True, **kwargs):
    assert not pretrained, "that would download"
    return Transformer(**kwargs)
""",
    "dinov3/models.py": """
import torch

class Transformer(torch.nn.Module):
    patch_size, embed_dim = 16, 1280

    def __init__(self, drop_path):
        super().__init__()
        self.drop_path = drop_path
        self.cls_token = torch.nn.Parameter(torch.empty(1, 1, 2))
        self.mask_token = torch.nn.Parameter(torch.zeros(1, 2))  # the published checkpoint lacks it
""",
}


MASKS = np.zeros((2, 48, 64), bool)
MASKS[0, 5:45, 10:30] = True
PEOPLE = People(MASKS, np.array([[10.0, 5, 30, 45], [40.0, 10, 60, 40]]), np.ones(2))


@pytest.fixture
def make_sam(stub, tmp_path):
    """A backend on files of its own; ``checkpoint`` is what its checkpoint holds."""
    files = tmp_path / "files"
    checkout = stub("sam", {"sam_3d_body/__init__.py": CHECKOUT})

    def make(
        backbone="vit_hmr_512_384",
        decoder="    TYPE: sam\n",
        checkpoint=None,
        **options,
    ):
        (files / "assets").mkdir(parents=True, exist_ok=True)
        (files / "assets/mhr_model.pt").write_bytes(b"")
        torch.save(
            {"state_dict": {"gain": torch.ones(1)}} if checkpoint is None else checkpoint,
            files / "model.ckpt",
        )
        (files / "model_config.yaml").write_text(
            f"MODEL:\n  BACKBONE:\n    TYPE: {backbone}\n  DECODER:\n{decoder}"
        )
        options = Sam3dBodyOptions(checkout=str(checkout), batch=1, **options)
        return reading(Sam3dBody(options), files)

    return make


@pytest.fixture
def load_sam(make_sam):
    """A loaded one, on the CPU, which its own ``load`` refuses."""

    def load(*names, **options):
        backend = make_sam(*names, **options)
        TorchBackend.load(backend)
        return backend

    return load


@pytest.fixture
def sam(load_sam):
    return load_sam()


def run_network(backend, camera=CAMERA):
    image = np.full((48, 64, 3), [200, 100, 10], np.uint8)
    return backend.infer(image, PEOPLE, camera, NUM_KEYPOINTS, Hints())


@pytest.mark.parametrize("decoder", ["", "    USE_INTRIN_CENTER: true\n"])
def test_bodies_lie_where_the_given_camera_sees_their_boxes(decoder, load_sam):
    """Unless its config says otherwise, the network takes the middle of the photo for the principal
    point.
    """
    sam = load_sam(decoder="    TYPE: sam\n" + decoder)
    centre = (12.0, 40.25)
    camera = Intrinsics(500.0, 500.0, *centre, 64, 48)
    place = run_network(sam, camera).parameters.transl
    pixels = 500 * place[:, :2] / place[:, 2:] + np.array(centre)
    middles = (PEOPLE.boxes[:, :2] + PEOPLE.boxes[:, 2:] - 1) / 2
    np.testing.assert_allclose(pixels, middles, atol=1e-4)


def test_dinov3_comes_from_the_named_folder_and_nothing_is_fetched(make_sam, stub, monkeypatch):
    monkeypatch.setattr(torch.hub, "load", lambda *_, **__: pytest.fail("it asks the hub"))
    before = torch.hub.load, torch.load
    checkpoint = {
        "state_dict": {
            "gain": torch.ones(1),
            "backbone.encoder.cls_token": torch.full((1, 1, 2), 0.5),
        }
    }
    sam = make_sam(
        "dinov3_vith16plus", checkpoint=checkpoint, dinov3_checkout=str(stub("dinov3", DINOV3))
    )
    assert not any("DINOv3" in line for line in sam.missing())
    TorchBackend.load(sam)
    assert sam.network.model.backbone.encoder.cls_token.tolist() == [[[0.5, 0.5]]]
    assert sam.network.model.backbone.encoder.drop_path == 0.1
    assert (torch.hub.load, torch.load) == before
    assert "dinov3" not in sys.modules
    assert sam.fingerprint() != make_sam("dinov3_vith16plus").fingerprint()


@pytest.mark.parametrize("encoder", [{}, {"backbone.encoder.cls_token": torch.zeros(1, 1, 3)}])
def test_weights_missing_in_the_checkpoint_are_not_initialised_randomly(encoder, load_sam, stub):
    """Its code goes on with random ones, and another version of DINOv3 has other names."""
    checkpoint = {"state_dict": {"gain": torch.ones(1), **encoder}}
    dinov3 = str(stub("dinov3", DINOV3))
    with pytest.raises(BackendError, match=r"missing 1 of 5 .* backbone\.encoder\.cls_token"):
        load_sam("dinov3_vith16plus", checkpoint=checkpoint, dinov3_checkout=dinov3)


def test_it_needs_a_gpu_and_says_so(sam):
    with pytest.raises(DeviceError, match="a GPU only, got 'cpu'"):
        sam.load("cpu")


def test_the_translation_is_added_to_surface_and_joints(sam):
    bodies = run_network(sam)
    assert bodies.body_model == "mhr"
    place = np.array([(49.5 - 30) / 500 * 3, (24.5 - 20) / 500 * 3, 3])
    np.testing.assert_allclose(bodies.mesh.vertices[1], np.tile(place + 0.5, (5, 1)), rtol=1e-6)
    np.testing.assert_allclose(
        bodies.joints[1, JOINT_INDEX["left_hip"]], place + np.array([27, 28, 29]), rtol=1e-6
    )
    assert not bodies.parameters.body_pose.any()
