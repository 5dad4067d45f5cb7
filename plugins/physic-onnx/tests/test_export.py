"""Exporting from checkouts with the published call signatures, and running what was exported."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from physic_core.body import load_body
from physic_core.types import Bodies, Hints, Intrinsics, Keypoints, People
from physic_onnx.camerahmr import CameraHmr
from physic_onnx.deco import Deco
from physic_onnx.export.__main__ import main
from physic_onnx.wilor import Wilor
from physic_testing.body_files import mano_arrays, smpl_arrays, write_published

CAMERAHMR = """
import torch
from torch import nn
from .constants import NUM_POSE_PARAMS

class CameraHMR(nn.Module):
    def __init__(self):
        super().__init__()
        open("data/smpl_mean_params.npz", "rb").close()  # found from the root of the checkout
        self.backbone = nn.Conv2d(3, 4, 64, stride=64)
        self.head = nn.Linear(7, 24 * 9 + 10 + 3)

    def forward(self, batch):
        x = batch["img"]
        features = self.backbone(x[:, :, :, 32:-32]).mean((2, 3))
        cx, cy, b = batch["box_center"][:, 0], batch["box_center"][:, 1], batch["box_size"]
        img_h, img_w = batch["img_size"][:, 0], batch["img_size"][:, 1]
        fl_h = batch["cam_int"][:, 0, 0]
        info = torch.stack([cx - img_w / 2.0, cy - img_h / 2.0, b], dim=-1) / fl_h[:, None]
        out = self.head(torch.cat([features, info], 1))
        params = {
            "global_orient": out[:, :9].view(x.shape[0], -1, 3, 3),
            "body_pose": out[:, 9:216].view(x.shape[0], -1, 3, 3)[:, :NUM_POSE_PARAMS],
            "betas": out[:, 216:226],
        }
        return params, torch.cat([out[:, 226:227].exp(), out[:, 227:229]], 1), fl_h
"""
SMPLX = """
import pickle
import numpy as np
import torch
from torch import nn

class Output:
    def __init__(self, joints, vertices):
        self.joints, self.vertices = joints, vertices

class SMPLLayer(nn.Module):
    def __init__(self, model_path, num_betas=10):
        super().__init__()
        with open(model_path, "rb") as file:
            data = pickle.load(file, encoding="latin1")
        self.register_buffer("v_template", torch.tensor(np.array(data["v_template"], dtype=np.float32)))
        self.faces = data["f"]

    def forward(self, betas, body_pose, global_orient):
        vertices = torch.einsum("bij,vj->bvi", global_orient[:, 0], self.v_template) * (1 + betas[:, :1, None])
        return Output(torch.cat([vertices, vertices[:, :15]], 1), vertices)  # SMPLLayer has 45 joints, 24 first
"""
WILOR = """
import os
import pickle
import numpy as np
import torch
from torch import nn

class WiLor(nn.Module):
    def __init__(self, **kwargs):
        super().__init__()
        open(kwargs["mano_mean_path"], "rb").close()
        with open(kwargs["mano_model_path"], "rb") as file:
            assert pickle.load(file, encoding="latin1")["shapedirs"].shape == (778, 3, 10)
        assert "RIGHT" in os.path.basename(kwargs["mano_model_path"])  # by which smplx tells hands
        self.head = nn.Linear(3, 15 * 3 + 3 + 3)
        self.mean = torch.tensor([0.485, 0.456, 0.406]).reshape(1, 1, 1, 3)
        self.std = torch.tensor([0.229, 0.224, 0.225]).reshape(1, 1, 1, 3)

    def forward(self, x):
        x = x.flip(dims=[-1]) / 255.0
        x = ((x - self.mean) / self.std).permute(0, 3, 1, 2)
        out = self.head(x[:, :, :, 32:-32].mean((2, 3)))
        return {
            "global_orient": out[:, 45:48].reshape(-1, 1, 3),
            "hand_pose": out[:, :45].reshape(-1, 15, 3),
            "betas": out[:, :10],
            "pred_cam": out[:, 48:51],
            "pred_keypoints_3d": out[:, :48].reshape(-1, 16, 3),
            "pred_vertices": out[:, :48].reshape(-1, 16, 3),
        }
"""
DECO = """
import torch
from torch import nn

class DECO(nn.Module):
    def __init__(self, encoder, context, device):
        super().__init__()
        self.classif = nn.Linear(3, 12)

    def forward(self, img):
        return torch.sigmoid(self.classif(img.mean((2, 3)))), img, img
"""


def write(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def noise(**shapes: tuple[int, ...]) -> dict[str, torch.Tensor]:
    torch.manual_seed(1)
    return {name.replace("__", "."): 0.1 * torch.randn(shape) for name, shape in shapes.items()}


IMAGE = np.random.default_rng(0).integers(0, 256, (240, 320, 3), np.uint8)
BOXES = np.array([[40.0, 20.0, 120.0, 220.0], [150.0, 60.0, 260.0, 200.0], [5.0, 5.0, 60.0, 200.0]])
PEOPLE = People(np.zeros((3, 240, 320), bool), BOXES, np.ones(3))
CAMERA = Intrinsics(400.0, 400.0, 150.0, 110.0, 320, 240)
NO_KEYPOINTS = Keypoints(np.zeros((3, 17, 2)), np.zeros((3, 17)), "coco17")


@pytest.fixture
def camerahmr(tmp_path: Path) -> Path:
    root = write(
        tmp_path / "CameraHMR",
        {
            "core/__init__.py": "",
            "core/constants.py": "NUM_POSE_PARAMS = 23\n",
            "core/camerahmr_model.py": CAMERAHMR,
            "smplx.py": SMPLX,
            "data/smpl_mean_params.npz": "",
            "data/models/SMPL/x": "",
            "data/pretrained-models/other": "",
        },
    )
    write_published(root / "data/models/SMPL/SMPL_NEUTRAL.pkl", smpl_arrays())
    network = noise(backbone__weight=(4, 3, 64, 64), backbone__bias=(4,), head__weight=(229, 7), head__bias=(229,))
    path = root / "data/pretrained-models/camerahmr_checkpoint_cleaned.ckpt"
    torch.save({"state_dict": network}, path)
    return root


def test_camerahmr_runs_as_it_was_exported(camerahmr: Path, tmp_path: Path, capsys: Any) -> None:
    file = tmp_path / "out" / "model.onnx"
    assert main(["camerahmr", "--checkout", str(camerahmr), "--output", str(file)]) == 0
    assert "differ by" in capsys.readouterr().out
    backend = CameraHmr(CameraHmr.Options(weights=str(file), batch=2))
    backend.load()
    found = backend.infer(IMAGE, PEOPLE, CAMERA, NO_KEYPOINTS, Hints())
    assert found.body_model == "smpl"
    assert found.mesh is not None
    assert found.mesh.vertices.shape == (3, 6890, 3)
    assert found.mesh.faces.shape == (13776, 3)
    assert found.mesh.rest is not None
    assert np.allclose(found.mesh.rest, smpl_arrays()["v_template"], atol=1e-6)
    assert found.joints is not None
    # the stub's joints are its first vertices
    assert np.allclose(found.joints[:, :22], found.mesh.vertices[:, :22], atol=1e-5)
    assert (found.parameters.transl[:, 2] > 0).all()


def test_wilor_runs_as_it_was_exported(tmp_path: Path, capsys: Any) -> None:
    root = write(
        tmp_path / "WiLoR-mini",
        {
            "wilor_mini/__init__.py": "",
            "wilor_mini/models/__init__.py": "",
            "wilor_mini/models/wilor.py": WILOR,
            "files/mano_mean_params.npz": "",
        },
    )
    write_published(root / "files/MANO_RIGHT.pkl", mano_arrays())
    torch.save({"state_dict": noise(head__weight=(51, 3), head__bias=(51,))}, root / "files/wilor_final.ckpt")
    file = tmp_path / "model.onnx"
    command = ["wilor", "--checkout", str(root), "--files", str(root / "files"), "--output", str(file)]
    assert main(command) == 0, capsys.readouterr().err
    backend = Wilor(Wilor.Options(weights=str(file)))
    backend.load()
    points = np.zeros((3, 17, 2))
    points[:, [5, 7, 9]] = [[60, 60], [60, 100], [60, 140]]
    points[:, [6, 8, 10]] = [[160, 60], [160, 100], [160, 140]]
    found = backend.infer(IMAGE, PEOPLE, Keypoints(points, np.ones((3, 17)), "coco17"))
    assert (found.confidence == 1).all()
    assert found.wrists is not None
    assert np.ptp(found.rotvecs, axis=0).max() < 1e-6  # the same hands for everybody


def test_deco_runs_as_it_was_exported(tmp_path: Path, capsys: Any) -> None:
    import trimesh

    root = write(
        tmp_path / "deco",
        {"models/__init__.py": "", "models/deco.py": DECO, "data/smpl/x": "", "checkpoints/Release_Checkpoint/x": ""},
    )
    rest, faces = np.random.default_rng(0).random((12, 3)), np.arange(12).reshape(4, 3)
    trimesh.Trimesh(rest, faces, process=False).export(root / "data/smpl/smpl_neutral_tpose.ply")
    torch.save(
        {"deco": noise(classif__weight=(12, 3), classif__bias=(12,))},
        root / "checkpoints/Release_Checkpoint/deco_best.pth",
    )
    file = tmp_path / "model.onnx"
    assert main(["deco", "--checkout", str(root), "--output", str(file)]) == 0, capsys.readouterr().err
    backend = Deco(Deco.Options(weights=str(file)))
    backend.load()
    found = backend.infer(IMAGE, PEOPLE, nobodies())
    assert found.topology == "smpl"
    assert found.probability.shape == (3, 12)
    assert found.rest is not None
    assert np.allclose(found.rest.vertices, rest, atol=1e-6)
    assert found.rest.faces.tolist() == faces.tolist()


def nobodies() -> Bodies:
    from physic_core.body.parameters import parameters_from_rotations

    rotations, betas, transl = load_body("embedded").zero_pose(3)
    return Bodies(parameters_from_rotations(rotations, betas, None, transl), "embedded")


def test_missing_files_of_the_export_are_named(tmp_path: Path, capsys: Any, camerahmr: Path) -> None:
    assert main(["camerahmr", "--checkout", str(tmp_path), "--output", str(tmp_path / "x.onnx")]) == 1
    assert "is no checkout of CameraHMR" in capsys.readouterr().err
    (camerahmr / "data/models/SMPL/SMPL_NEUTRAL.pkl").unlink()
    assert main(["camerahmr", "--checkout", str(camerahmr), "--output", str(tmp_path / "x.onnx")]) == 1
    assert "there is no file" in capsys.readouterr().err


def test_a_file_of_smpl_that_would_run_code_is_refused(tmp_path: Path, capsys: Any, camerahmr: Path) -> None:
    harm = pickle.dumps({**smpl_arrays(), "bs_type": print})
    (camerahmr / "data/models/SMPL/SMPL_NEUTRAL.pkl").write_bytes(harm)
    assert main(["camerahmr", "--checkout", str(camerahmr), "--output", str(tmp_path / "x.onnx")]) == 1
    assert "is a pickle that asks for 'builtins.print'" in capsys.readouterr().err


def test_another_checkpoint_is_refused(tmp_path: Path, capsys: Any, camerahmr: Path) -> None:
    path = camerahmr / "data/pretrained-models/camerahmr_checkpoint_cleaned.ckpt"
    torch.save({"state_dict": {"backbone.bias": torch.zeros(4)}}, path)
    assert main(["camerahmr", "--checkout", str(camerahmr), "--output", str(tmp_path / "x.onnx")]) == 1
    assert "is missing 3 parameters of the network" in capsys.readouterr().err


def test_a_checkpoint_with_objects_is_not_run_unasked(tmp_path: Path, capsys: Any, camerahmr: Path) -> None:
    path = camerahmr / "data/pretrained-models/camerahmr_checkpoint_cleaned.ckpt"
    held = torch.load(path)
    torch.save({**held, "config": Path("/etc")}, path)
    command = ["camerahmr", "--checkout", str(camerahmr), "--output", str(tmp_path / "x.onnx")]
    assert main(command) == 1
    assert "--trust" in capsys.readouterr().err
    assert main([*command, "--trust"]) == 0
