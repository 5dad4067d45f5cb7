"""InstantHMR: its crop, the condition of the box, its camera and the pipeline's."""

from __future__ import annotations

import warnings
from dataclasses import replace

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from scipy.spatial.transform import Rotation

from physic_core.adapters.bodies import joints_from_mhr70
from physic_core.body import load_body
from physic_core.body.bones import rotations_from_parameters, rotations_from_tpose
from physic_core.body.convert.bodies import convert_with_residuals
from physic_core.body.joints import JOINT_INDEX
from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator
from physic_core.types import Hints, Intrinsics, Keypoints, People
from physic_onnx.instanthmr import InstantHmr
from physic_onnx.mhr import JOINT_OF_MHR, MhrModel
from physic_testing import violations

from .pose_worlds import normalised

INPUTS = {"image": ("float32", ("batch", 3, 224, 224)), "cliff_cond": ("float32", ("batch", 3))}
OUTPUTS = {
    "mhr_params": ("float32", ("batch", 204)),
    "shape_params": ("float32", ("batch", 45)),
    "cam_trans": ("float32", ("batch", 3)),
    "joints_2d": ("float32", ("batch", 70, 2)),
    "joints_3d": ("float32", ("batch", 70, 3)),
}
IMAGE = cv2.GaussianBlur(
    np.random.default_rng(0).integers(0, 256, (300, 400, 3), np.uint8), (0, 0), 3
)
BOXES = np.array(
    [[101.3, 40.2, 180.9, 260.6], [0.0, 10.0, 70.5, 299.0], [250.0, 60.0, 400.0, 160.0]]
)
PEOPLE = People(np.zeros((3, 300, 400), bool), BOXES, np.ones(3))
NO_KEYPOINTS = Keypoints(np.zeros((3, 17, 2)), np.zeros((3, 17)), "coco17")
OWN_CAMERA = Intrinsics(500.0, 500.0, 199.5, 149.5, 400, 300)
"""The network's own: the diagonal of the photo, and its centre."""


@pytest.fixture
def graph_file(tmp_path, graph, node):
    """A network with random weights: each output is linear in the picture and the condition."""

    def make(metadata=None, outputs=OUTPUTS):
        rng = np.random.default_rng(1)
        nodes = [
            node("AveragePool", ["image"], ["pooled"], kernel_shape=[28, 28], strides=[28, 28]),
            node("Flatten", ["pooled"], ["flat"]),
            node("Concat", ["flat", "cliff_cond"], ["seen"], axis=1),
        ]
        constants = {}
        for name, (_, (_, *shape)) in outputs.items():
            bias = (
                np.array([0.1, 0.2, 4.0])
                if name == "cam_trans"
                else rng.normal(0, 0.3, int(np.prod(shape)))
            )
            constants[f"{name} weights"] = rng.normal(0, 0.02, (195, len(bias))).astype(np.float32)
            constants[f"{name} bias"] = bias.astype(np.float32)
            constants[f"{name} shape"] = np.array([-1, *shape])
            nodes += [
                node("Gemm", ["seen", f"{name} weights", f"{name} bias"], [f"{name} flat"]),
                node("Reshape", [f"{name} flat", f"{name} shape"], [name]),
            ]
        path = graph(tmp_path / "instanthmr.onnx", INPUTS, outputs, nodes, constants)
        if metadata:
            model = onnx.load(path)
            onnx.helper.set_model_props(model, metadata)
            onnx.save(model, path)
        return path

    return make


def as_published(path, image, box):
    """(70, 3) metres in the network's own camera and (45,) shape, by the steps that its repository
    describes.
    """
    height, width = image.shape[:2]
    x0, y0, x1, y1 = box
    side = max(x1 - x0, y1 - y0)
    left = (x0 + x1) / 2 - 0.6 * side
    top = (y0 + y1) / 2 - 0.6 * side
    columns = int(np.floor(left)), int(np.ceil(left + 1.2 * side))
    rows = int(np.floor(top)), int(np.ceil(top + 1.2 * side))
    beyond = 300
    framed = np.pad(image, ((beyond, beyond), (beyond, beyond), (0, 0)))
    patch = framed[beyond + rows[0] : beyond + rows[1], beyond + columns[0] : beyond + columns[1]]
    picture = cv2.resize(patch, (224, 224), interpolation=cv2.INTER_LINEAR)
    condition = [(x0 + x1) / width - 1, (y0 + y1) / height - 1, side / max(height, width)]
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    feed = {
        "image": normalised(picture)[None].astype(np.float32),
        "cliff_cond": np.array([condition], np.float32),
    }
    shape, place, points = session.run(["shape_params", "cam_trans", "joints_3d"], feed)
    return points[0] + place[0], shape[0]


def project(points, camera):
    return points[..., :2] / points[..., 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]


@pytest.mark.parametrize("batch", [1, 8])
def test_in_its_own_camera_bodies_are_those_of_the_published_steps(graph_file, loaded, batch):
    path = graph_file()
    found = loaded(InstantHmr, path, batch=batch).infer(
        IMAGE, PEOPLE, OWN_CAMERA, NO_KEYPOINTS, Hints()
    )
    expected = [as_published(path, IMAGE, box) for box in BOXES]
    joints = joints_from_mhr70(np.stack([points for points, _ in expected]))
    assert found.body_model == "mhr"
    # The crops differ by one grey level at most, which these weights make 2 mm; one pixel aside is
    # 20 mm.
    np.testing.assert_allclose(found.joints, joints, atol=3e-3)
    np.testing.assert_allclose(found.parameters.betas, [shape for _, shape in expected], atol=3e-3)


def test_in_another_camera_the_hips_keep_their_pixel_and_their_size(graph_file, loaded):
    backend = loaded(InstantHmr, graph_file())
    camera = Intrinsics(400.0, 900.0, 150.0, 170.0, 400, 300)
    own, other = (
        backend.infer(IMAGE, PEOPLE, c, NO_KEYPOINTS, Hints()).joints for c in (OWN_CAMERA, camera)
    )
    hips = [JOINT_INDEX["left_hip"], JOINT_INDEX["right_hip"]]
    middle, moved = (joints[:, hips].mean(axis=1) for joints in (own, other))
    np.testing.assert_allclose(project(moved, camera), project(middle, OWN_CAMERA), atol=1e-3)
    np.testing.assert_allclose(600 / moved[:, 2], 500 / middle[:, 2], rtol=1e-5)  # px of a metre
    np.testing.assert_allclose(other - moved[:, None], own - middle[:, None], atol=1e-5)


def test_a_cliff_focal_network_gets_the_box_as_angles_of_the_given_camera(
    graph_file, loaded, monkeypatch
):
    """[atan((cx - W / 2) / f), atan((cy - H / 2) / f), side / f], as its training describes it."""
    backend = loaded(InstantHmr, graph_file({"cliff_focal": "true"}))
    camera = Intrinsics(900.0, 900.0, 199.5, 149.5, 400, 300)
    fed = {}
    run = backend.network.network.run

    def recorded(feed, names):
        fed.update(feed)
        return run(feed, names)

    monkeypatch.setattr(backend.network.network, "run", recorded)
    found = backend.infer(IMAGE, PEOPLE, camera, NO_KEYPOINTS, Hints())
    x, y, side = fed["cliff_cond"].astype(float).T
    np.testing.assert_allclose(np.tan(x) * 900 + 200, BOXES[:, [0, 2]].mean(1), atol=0.01)
    np.testing.assert_allclose(np.tan(y) * 900 + 150, BOXES[:, [1, 3]].mean(1), atol=0.01)
    np.testing.assert_allclose(side * 900, (BOXES[:, 2:] - BOXES[:, :2]).max(1), atol=0.01)
    place, points = run(fed, ["cam_trans", "joints_3d"])
    np.testing.assert_allclose(found.joints, joints_from_mhr70(points + place[:, None]), atol=1e-4)


class FakeMhr(torch.nn.Module):
    """MHR's door, with bodies that are looked up by the first parameter of pose; the first body is
    the one at rest.
    """

    def __init__(self, names: list[str], states: np.ndarray) -> None:
        super().__init__()
        self.names = names
        self.register_buffer("states", torch.from_numpy(states.astype(np.float32)))
        self.character_torch = torch.nn.Module()
        self.character_torch.mesh = torch.nn.Module()
        self.character_torch.mesh.register_buffer("faces", torch.tensor([[0, 1, 2]]))

    @torch.jit.export
    def get_joint_names(self) -> list[str]:
        return self.names

    def forward(
        self, shape: torch.Tensor, pose: torch.Tensor, expression: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        rows = pose[:, 0].round().long()
        return self.states[rows][:, :, :3], self.states[rows]


def test_parameters_become_bodies_with_mesh_and_rotations_by_mhr(
    graph_file, stand_in_network, tmp_path
):
    """MHR rests in an A-pose, with joints turned as it likes; rotations alone show how a hand is
    turned.
    """
    model = load_body("embedded")
    down = np.radians(45)
    poses = np.random.default_rng(4).normal(0, 0.25, (4, 55, 3))
    poses[0] = 0
    poses[0, [JOINT_INDEX["left_shoulder"], JOINT_INDEX["right_shoulder"]], 2] = -down, down
    poses[1:, 0] = Rotation.from_euler("x", np.pi).as_rotvec()
    poses[1:, [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]], 0] = 0.9
    local = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(4, 55, 3, 3)
    places = model(
        torch.from_numpy(local).float(),
        torch.zeros(4, model.num_betas),
        torch.zeros(4, 3),
        joints_only=True,
    ).joints.numpy()
    world = rotations_from_tpose(local)
    ours = [JOINT_INDEX[name] for name in JOINT_OF_MHR]
    own_turns = Rotation.random(len(ours), rng=5).as_matrix()
    flip = np.diag([1.0, -1.0, -1.0])
    states = np.zeros((4, 1 + len(ours), 8))
    for body, axes in enumerate([np.eye(3), flip, flip, flip]):
        states[body, 1:, :3] = 100 * places[body, ours] @ axes
        turns = axes @ world[body, ours] @ np.swapaxes(world[0, ours], -1, -2) @ own_turns
        states[body, 1:, 3:7] = Rotation.from_matrix(turns).as_quat()
    states[:, 0, 6] = 1
    path = tmp_path / "mhr_model.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.script(FakeMhr(["body_world", *JOINT_OF_MHR.values()], states)).save(str(path))
    answers = {
        name: np.zeros((3, *shape[1:]))
        for name, (_, shape) in OUTPUTS.items()
        if name != "joints_3d"
    }
    answers["mhr_params"][:, 0] = 1, 2, 3
    answers["cam_trans"][:] = [0.1, 0.2, 4.0]
    outputs = {name: OUTPUTS[name] for name in answers}
    network = stand_in_network(INPUTS, outputs, lambda fed: answers)
    backend = InstantHmr(InstantHmr.Options(mhr=str(path)))
    backend._mhr = MhrModel(path)
    backend._network = backend.match(network)
    found = backend.infer(IMAGE, PEOPLE, OWN_CAMERA, NO_KEYPOINTS, Hints())
    np.testing.assert_allclose(
        found.mesh.vertices[:, 1:], places[1:, ours] + [0.1, 0.2, 4.0], atol=1e-3
    )
    assert violations(BodyEstimator, found, people=3) == []

    def wrist_errors_deg(bodies):
        converted = convert_with_residuals(bodies, model).bodies.parameters
        turned = rotations_from_tpose(rotations_from_parameters(converted).numpy())
        wrists = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]
        apart = np.swapaxes(turned[:, wrists], -1, -2) @ world[1:, wrists]
        return np.degrees(Rotation.from_matrix(apart.reshape(-1, 3, 3)).magnitude())

    bare = replace(found, mesh=None, tpose_rotations=False)
    assert wrist_errors_deg(found).max() < 20 < wrist_errors_deg(bare).max()


def test_a_network_without_keypoints_in_3d_needs_the_body_model(graph_file, loaded):
    path = graph_file(outputs={name: port for name, port in OUTPUTS.items() if name != "joints_3d"})
    with pytest.raises(BackendError, match="option mhr"):
        loaded(InstantHmr, path)


def test_a_body_behind_the_camera_is_not_a_number(bound):
    answers = {name: np.zeros((3, *shape[1:])) for name, (_, shape) in OUTPUTS.items()}
    answers["cam_trans"] -= 1
    backend = bound(InstantHmr, INPUTS, OUTPUTS, lambda fed: answers)
    found = backend.infer(IMAGE, PEOPLE, OWN_CAMERA, NO_KEYPOINTS, Hints())
    assert np.isnan(found.parameters.transl).all()
