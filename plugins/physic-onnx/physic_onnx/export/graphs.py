"""Wrap networks of published repositories to give them the inputs and outputs that the backends expect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["CAMERAHMR", "DECO", "WILOR", "CameraHmrGraph", "DecoGraph", "Ports", "WilorGraph", "example_inputs"]

Ports = tuple[tuple[str, ...], tuple[str, ...]]
"""Names of inputs and outputs."""

CAMERAHMR: Ports = (
    ("img", "box_center", "box_size", "img_size", "cam_int"),
    ("global_orient", "body_pose", "betas", "pred_cam", "joints", "vertices", "faces", "rest"),
)
WILOR: Ports = (("image",), ("hand_pose", "global_orient", "pred_cam", "joints"))
DECO: Ports = (("image",), ("contact", "faces", "rest"))

UNBATCHED = ("faces", "rest")
"""Names of outputs without a batch axis."""


class CameraHmrGraph(nn.Module):
    """CameraHMR and SMPL in one module: rotations, shape, weak-perspective camera, and the mesh without translation.

    Args:
        network: of the checkout; called with its batch, a dictionary, it returns parameters, camera, focal length.
        smpl: an SMPL layer that takes rotation matrices.
    """

    def __init__(self, network: nn.Module, smpl: Any) -> None:
        super().__init__()
        self.network, self.smpl = network, smpl
        self.register_buffer("faces", _faces(smpl.faces))
        self.register_buffer("rest", smpl.v_template.detach().float().clone())

    def forward(
        self, img: Tensor, box_center: Tensor, box_size: Tensor, img_size: Tensor, cam_int: Tensor
    ) -> tuple[Tensor, ...]:
        """Run CameraHMR and SMPL and return the outputs of ``CAMERAHMR``.

        The inputs are (B, 3, 256, 256), (B, 2), (B,), (B, 2) and (B, 3, 3).
        """
        batch = {"img": img, "box_center": box_center, "box_size": box_size, "img_size": img_size, "cam_int": cam_int}
        parameters, camera, *_ = self.network(batch)
        body = self.smpl(**parameters)
        orient, pose, betas = (parameters[name] for name in ("global_orient", "body_pose", "betas"))
        return (
            orient.reshape(-1, 1, 3, 3),
            pose.reshape(-1, 23, 3, 3),
            betas,
            camera,
            body.joints[:, :24],
            body.vertices,
            *_held(self, img),
        )


class WilorGraph(nn.Module):
    """WiLoR-mini's network with the outputs of WILOR.

    Args:
        network: of the checkout; shown (B, 256, 256, 3) it returns a dictionary.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """Run WiLoR on images (B, 256, 256, 3), BGR from 0 to 255, and return the outputs of ``WILOR``."""
        found = self.network(image)
        return found["hand_pose"], found["global_orient"], found["pred_cam"], found["pred_keypoints_3d"]


class DecoGraph(nn.Module):
    """DECO's contact output with the T-pose and faces of its SMPL mesh.

    Args:
        network: of the checkout; its first output is the contact.
        rest: (6890, 3) metres.
        faces: (F, 3).
    """

    def __init__(self, network: nn.Module, rest: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        super().__init__()
        self.network = network
        self.register_buffer("faces", _faces(faces))
        self.register_buffer("rest", torch.as_tensor(rest, dtype=torch.float32))

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        """Run DECO on images (B, 3, 256, 256) and return the outputs of ``DECO``."""
        found = self.network(image)
        contact = found[0] if isinstance(found, (tuple, list)) else found
        return contact, *_held(self, image)


def example_inputs(name: str, rows: int = 2) -> tuple[Tensor, ...]:
    """Return example inputs of a network for tracing."""
    rng = torch.Generator().manual_seed(0)
    if name == "wilor":
        return (torch.rand(rows, 256, 256, 3, generator=rng) * 255,)
    picture = torch.randn(rows, 3, 256, 256, generator=rng)
    if name == "deco":
        return (picture,)
    camera = torch.tensor([[900.0, 0.0, 320.0], [0.0, 900.0, 240.0], [0.0, 0.0, 1.0]]).repeat(rows, 1, 1)
    centre = torch.tensor([[300.0, 260.0]]).repeat(rows, 1) + 10 * torch.arange(rows)[:, None]
    return picture, centre, torch.full((rows,), 220.0), torch.tensor([[480.0, 640.0]]).repeat(rows, 1), camera


def _held(module: nn.Module, shown: Tensor) -> tuple[Tensor, Tensor]:
    """Return faces and rest vertices. They get a formal dependence on the input, because the exporter drops the names
    of constant outputs.
    """
    nothing = shown.size(0) * 0
    faces, rest = module.get_buffer("faces"), module.get_buffer("rest")
    return faces + nothing, rest + nothing


def _faces(faces: Any) -> Tensor:
    """Convert faces to an int64 tensor."""
    return torch.from_numpy(np.asarray(faces).astype(np.int64))
