"""NLF: a TorchScript file with its methods, run for real."""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.errors import BackendError
from physic_core.types import Hints, Intrinsics, Keypoints, People
from physic_human.nlf import Nlf, NlfOptions

CAMERA = Intrinsics(500.0, 510.0, 30.0, 20.0, 64, 48)
BOXES = np.array([[10.0, 5, 30, 45], [40.0, 10, 60, 40]])
BLACK = np.zeros((48, 64, 3), np.uint8)
NO_KEYPOINTS = Keypoints(np.zeros((2, 17, 2)), np.zeros((2, 17)), "coco17")


class TinyNlf(torch.nn.Module):
    """The published signature; answers tell what came in, in their joints."""

    def __init__(self, relative: bool, joints: int) -> None:
        super().__init__()
        self.relative = relative
        self.joints = joints

    @torch.jit.export
    def estimate_smpl_batched(
        self,
        images: torch.Tensor,
        boxes: list[torch.Tensor],
        intrinsic_matrix: torch.Tensor | None = None,
        distortion_coeffs: torch.Tensor | None = None,
        extrinsic_matrix: torch.Tensor | None = None,
        world_up_vector: torch.Tensor | None = None,
        default_fov_degrees: float = 55.0,
        internal_batch_size: int = 64,
        antialias_factor: int = 1,
        num_aug: int = 1,
        rot_aug_max_degrees: float = 25.0,
        beta_regularizer: float = 10.0,
        beta_regularizer2: float = 0.0,
        model_name: str = "smpl",
    ) -> dict[str, list[torch.Tensor]]:
        assert images.dtype == torch.uint8
        assert images.dim() == 4
        assert model_name == ("smplx" if self.joints == 55 else "smpl")
        assert intrinsic_matrix is not None
        count = boxes[0].shape[0]
        assert count > 0
        joints = torch.zeros(count, self.joints, 3)
        joints[:, 0] = torch.tensor([100.0, -250.0, 3000.0])
        joints[:, 1] = boxes[0][:, :3]
        joints[:, 2, 0] = boxes[0][:, 3]
        joints[:, 2, 1] = intrinsic_matrix[0, 0, 0]
        joints[:, 2, 2] = intrinsic_matrix[0, 0, 2]
        joints[:, 3] = images[0].float().mean(dim=[1, 2])
        joints[:, 4] = torch.tensor([beta_regularizer, beta_regularizer2, float(num_aug)])
        joints[:, 5, 0] = float(internal_batch_size)
        pose = torch.zeros(count, 3 * self.joints)
        pose[:, 3] = 0.3
        pose[:, 3 * self.joints - 1] = 0.7
        points = torch.full((count, 1024, 3), 10.0) + torch.tensor([90.0, 0.0, 2900.0])
        few = torch.full((count, self.joints, 3), 10.0) + torch.tensor([90.0, 0.0, 2900.0])
        trans = torch.tensor([[0.1, 0.05, 3.0]]).expand(count, 3)
        if self.relative:
            trans = trans - torch.tensor([0.1, 0.01, 2.91])
        return {
            "boxes": [torch.cat([boxes[0], torch.ones(count, 1)], 1)],
            "pose": [pose],
            "betas": [torch.full((count, 10), 0.25)],
            "trans": [trans],
            "joints3d": [joints],
            "vertices3d": [torch.zeros(count, 10475, 3)],
            "joints3d_nonparam": [few],
            "vertices3d_nonparam": [points],
        }


def save(network, path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of TorchScript as a whole
        torch.jit.script(network).save(str(path))
    return str(path)


def ask(backend, image=BLACK, boxes=BOXES, keypoints=NO_KEYPOINTS):
    people = People(np.zeros((len(boxes), 48, 64), bool), boxes, np.ones(len(boxes)))
    return backend.infer(image, people, CAMERA, keypoints, Hints())


@pytest.fixture
def load(tmp_path, torchvision):
    """``load(relative, joints, **options)``: a backend with a file of this kind."""

    def make(relative=False, joints=55, **options):
        network = TinyNlf(relative, joints)
        weights = save(network, tmp_path / "nlf.torchscript")
        backend = Nlf(NlfOptions(weights=weights, **options))
        backend.load()
        return backend

    return make


@pytest.fixture
def nlf(load):
    return load(augmentations=3, beta_regularizer=1.5, batch=7)


def test_nlf_is_given_boxes_camera_photo_and_settings(nlf):
    """Boxes as left, top, width and height; grey levels, red first."""
    image = np.full((48, 64, 3), [200, 100, 10], np.uint8)
    first, second = 1000 * ask(nlf, image).joints
    boxes = [[10, 5, 20], [40, 500, 30]]
    wanted = [*boxes, [200, 100, 10], [1.5, 0, 3], [7, 0, 0]]
    np.testing.assert_allclose(first[1:6], wanted, rtol=1e-5)
    np.testing.assert_allclose(second[1:3], [[40, 10, 20], [30, 500, 30]], rtol=1e-5)


def test_millimetres_become_metres_and_poses_land_in_their_fields(nlf):
    bodies = ask(nlf)
    assert bodies.body_model == "smplx"
    np.testing.assert_allclose(bodies.joints[:, 0], [[0.1, -0.25, 3.0]] * 2, rtol=1e-5)
    np.testing.assert_allclose(bodies.parameters.transl, [[0.1, 0.05, 3.0]] * 2, rtol=1e-5)
    assert bodies.parameters.body_pose[0, 0] == pytest.approx(0.3)
    assert bodies.parameters.right_hand_pose[0, 44] == pytest.approx(0.7)
    assert bodies.parameters.betas.shape == (2, 10)
    assert bodies.parameters.expression.shape == (2, 10)


def test_translations_of_old_files_get_their_middle_back(load):
    found = ask(load(relative=True)).parameters.transl
    np.testing.assert_allclose(found, [[0.1, 0.05, 3.0]] * 2, rtol=1e-4)


def test_smpl_drops_the_hands_and_keeps_the_joints(load):
    bodies = ask(load(joints=24, body="smpl"))
    assert bodies.body_model == "smpl"
    np.testing.assert_allclose(bodies.joints[0, 0], [0.1, -0.25, 3.0], rtol=1e-5)
    assert np.isnan(bodies.joints[:, 22:]).all()


def test_joints_are_seen_where_their_keypoints_are(nlf):
    sure = np.ones((2, 17))
    sure[1, 13] = 0.4  # the left knee
    shown = Keypoints(np.full((2, 17, 2), 20.0), sure, "coco17")
    found = ask(nlf, keypoints=shown).observed
    assert np.argwhere(~found).tolist() == [[1, 4]]


def test_a_network_is_not_called_without_people(nlf):
    bodies = ask(nlf, boxes=np.zeros((0, 4)))
    assert len(bodies.parameters) == 0
    assert bodies.body_model == "smplx"


def test_torchvision_comes_before_the_file(load, monkeypatch):
    class Broken:
        def find_spec(self, name, path=None, target=None):
            if name == "torchvision":
                raise RuntimeError("operator torchvision::nms does not exist")

    monkeypatch.delitem(sys.modules, "torchvision", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    said = r"NLF needs torchvision.*the build that fits your torch \(RuntimeError: operator "
    with pytest.raises(BackendError, match=said):
        load()


def test_missing_names_weights_torchvision_and_body_file(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    options = NlfOptions(weights=str(tmp_path / "no.torchscript"), smplx_file="no.npz")
    words = (
        "no.torchscript",
        "pip install torchvision",
        "set smplx_file to your SMPLX_NEUTRAL.npz",
    )
    assert all(word in lack for word, lack in zip(words, Nlf(options).missing(), strict=True))


def test_other_files_are_refused(load, tmp_path):
    weights = tmp_path / "other.torchscript"
    weights.write_bytes(b"no model")
    with pytest.raises(BackendError, match="cannot be read as TorchScript"):
        Nlf(NlfOptions(weights=str(weights))).load()
    save(torch.nn.Linear(1, 1), weights)
    with pytest.raises(BackendError, match="is not a multi-person NLF"):
        Nlf(NlfOptions(weights=str(weights))).load()
    wrong = load(joints=24, body="smplx")
    with pytest.raises(Exception, match="AssertionError"):
        ask(wrong)


@pytest.fixture(scope="module")
def smplx_file(module_at, tmp_path_factory):
    """A made-up SMPL-X file whose pelvis is not at its origin and moves with the shape."""
    bodies = module_at("tests/body/other_body.py")
    path = tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz"
    np.savez_compressed(path, **bodies.smplx_file_arrays(bodies.make(load_body("embedded"), 10475)))
    return path


class ExactNlf:
    """Poses the user's own SMPL-X file; ``shift`` mm moves its vertices alone."""

    def __init__(self, file, shift):
        self.body = load_body(file)
        self.shift = shift

    def estimate_smpl_batched(self, images, boxes, **rest):
        import roma

        pose = 0.2 * torch.randn(2, 55, 3, generator=torch.Generator().manual_seed(0))
        betas = torch.full((2, 10), 0.5)
        transl = torch.tensor([[0.1, 0.2, 3.0], [-0.5, 0.1, 4.0]])
        with torch.no_grad():
            out = self.body(roma.rotvec_to_rotmat(pose), betas, transl)
        return {
            "pose": [pose.flatten(1)],
            "betas": [betas],
            "trans": [transl - 7.0],  # whatever: the pelvis tells
            "joints3d": [1000 * out.joints],
            "vertices3d": [1000 * out.vertices + self.shift],
        }


@pytest.fixture
def exact(load, smplx_file):
    """A loaded backend whose network poses the file exactly, with vertices some mm off."""

    def make(shift):
        backend = load(smplx_file=str(smplx_file))
        backend._network = ExactNlf(smplx_file, shift)
        return backend

    return make


def test_the_users_file_gives_the_exact_place_and_the_surface(exact):
    bodies = ask(exact(shift=0.0))
    places = [[0.1, 0.2, 3.0], [-0.5, 0.1, 4.0]]
    np.testing.assert_allclose(bodies.parameters.transl, places, atol=1e-5)
    assert bodies.mesh.vertices.shape == (2, 10475, 3)
    assert bodies.mesh.rest is not None


def test_a_file_other_than_nlfs_is_recognised_by_its_vertices(exact):
    with pytest.raises(BackendError, match=r"first body is 5[0-9]\.\d mm"):
        ask(exact(shift=30.0))
