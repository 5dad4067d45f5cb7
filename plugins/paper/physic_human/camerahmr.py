"""Estimate SMPL bodies with a checkout of CameraHMR (Patel and Black 2025), for the known camera.

Only its networks are used. Boxes are the people's, crops are made here, and SMPL is evaluated from
the user's own file, so neither detectron2 nor smplx is needed.

Three numbers (s, tx, ty) of the crop place a body. Its origin projects to ``centre + side / 2 * s *
(tx, ty)``, and one metre is ``side / 2 * s`` px long there. The translation in the photo's camera
projects to the same pixel, at the depth at which one metre is that long (CLIFF, Li et al. 2022,
with the principal point instead of the image centre).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator
from physic_human.smpl_backends import (
    SmplCheckoutBackend,
    SmplCheckoutOptions,
    open_smpl,
    pose_smpl_bodies,
)
from physic_networks.bodies import SeenConfidence, empty_bodies, observed_joints
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP, picture_tensor, to_numpy
from physic_networks.pictures import IMAGENET_MEAN, IMAGENET_STD, letterbox, normalized_nchw
from physic_networks.top_down import crop_around_box, padded_region, resample_crop

if TYPE_CHECKING:
    from collections.abc import Sequence

    import torch

    from physic_core.body import SmplBody
    from physic_core.types import (
        Bodies,
        FloatArray,
        Hints,
        Intrinsics,
        Keypoints,
        People,
        UInt8Array,
    )

_SMALLEST = 1e-6  # minimum |s|: output for an empty crop must not become an infinite depth

SIDE = 256
"""Side of the square input of both networks, px."""


def translation_from_crop(
    weak: FloatArray, centres: FloatArray, sides: FloatArray, camera: Intrinsics
) -> FloatArray:
    """Convert weak-perspective cameras of crops to translations in the photo's camera frame.

    Args:
        weak: (N, 3) s, tx, ty of each crop; s > 0.
        centres: (N, 2) px of the photo, centre of each crop; integer coordinates are pixel centres.
        sides: (N,) px of the photo, full side length of each square crop.
        camera: of the photo; focal lengths along x and y may differ.

    Returns:
        (N, 3) metres, camera frame; NaN where s is not positive.
    """
    s = weak[:, 0].astype(np.float64)
    shift = weak[:, 1:3].astype(np.float64)
    per_metre = sides / 2 * np.where(s > _SMALLEST, s, np.nan)
    focal = np.array([camera.fx, camera.fy])
    centre = np.array([camera.cx, camera.cy])
    depth = np.sqrt(camera.fx * camera.fy) / per_metre
    pixels = centres + per_metre[:, None] * shift
    across = (pixels - centre) / focal * depth[:, None]
    return np.concatenate([across, depth[:, None]], axis=1)


def camerahmr_inputs(
    centres: FloatArray, sides: FloatArray, focal: float, camera: Intrinsics
) -> dict[str, FloatArray]:
    """Return the box and camera inputs of CameraHMR's network, float32: input name -> array.

    The network assumes the principal point in the image centre, so boxes are shifted by the
    difference.

    Args:
        centres: (N, 2) px of the photo.
        sides: (N,) px of the photo.
        focal: focal length for the network, px.
        camera: of the photo.
    """
    middle = np.array([camera.width, camera.height]) / 2
    matrix = np.array([[focal, 0.0, middle[0]], [0.0, focal, middle[1]], [0.0, 0.0, 1.0]])
    inputs = {
        "box_center": centres - [camera.cx, camera.cy] + middle,
        "box_size": sides,
        "img_size": np.tile([float(camera.height), float(camera.width)], (len(centres), 1)),
        "cam_int": np.tile(matrix, (len(centres), 1, 1)),
    }
    return {name: np.asarray(value, np.float32) for name, value in inputs.items()}


class CameraHmrOptions(SmplCheckoutOptions):
    """Settings of CameraHMR."""

    weights: str = Field("camerahmr", description=WEIGHTS_HELP)
    smpl_file: str = Field(
        default="",
        description="your SMPL_NEUTRAL.npz or .pkl: gives the joints and the surface of a body",
    )
    seen_confidence: SeenConfidence = 0.5
    focal: Literal["given", "own"] = Field(
        default="given",
        description="focal length that the network gets: the camera's, or the estimate of "
        "CameraHMR's own FLNet; "
        "bodies are placed in the given camera either way",
    )
    focal_channels: Literal["rgb", "bgr"] = Field(
        default="rgb",
        description="order of the channels for FLNet, which was trained on rgb; the code of the "
        "PhySIC paper uses bgr",
    )


_CHECKPOINT = "camerahmr_checkpoint_cleaned.ckpt"
_CAMERA_CHECKPOINT = "cam_model_cleaned.ckpt"
_MEAN = "smpl_mean_params.npz"
_FLNET_NEEDS = ("loguru", "yacs")
_WHITE = 255


class CameraHmr(SmplCheckoutBackend, BodyEstimator):
    """Body estimator: SMPL bodies by CameraHMR with joints and mesh, in the given camera."""

    written_for = 1
    Options = CameraHmrOptions
    options: CameraHmrOptions
    reads = ("people", "intrinsics", "keypoints")
    project = Checkout(
        name="CameraHMR",
        package="core.camerahmr_model",
        homepage="https://github.com/pixelite1201/CameraHMR",
        commit="65d11a0640d23c60f55ec82ae54298e9e7e549e0",
        needs=("pytorch_lightning", "einops", "timm", "torchvision"),
    )

    def needed_packages(self) -> tuple[str, ...]:
        """Return the packages that the checkout imports, including those of FLNet if it is used."""
        return (*super().needed_packages(), *(_FLNET_NEEDS if self.options.focal == "own" else ()))

    def build(self, device: str) -> tuple[Any, Any, SmplBody]:
        """Return CameraHMR, FLNet or None, and the SMPL model, with their weights."""
        checkpoint = self.file(_CHECKPOINT)
        mean = self.file(_MEAN)
        body = open_smpl(self.options.smpl_file)
        constants: Any = self.checkout.load("core.constants")
        # its own path begins at the folder that Python was started in
        constants.SMPL_MEAN_PARAMS_FILE = str(mean)
        kind = self.checkout.attribute("CameraHMR")
        focal_network = None
        if self.options.focal == "own":
            camera_kind = self.checkout.attribute("FLNet", "core.cam_model.fl_net")
            with self.inference():
                focal_network = self.load_checkpoint_into(
                    camera_kind(), self.file(_CAMERA_CHECKPOINT)
                )
        with self.inference():
            return self.load_checkpoint_into(kind(), checkpoint), focal_network, body

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Return SMPL bodies of N people, metres, camera frame.

        Raises:
            BackendError: it is not loaded, or the output of the network has another form.
        """
        _, focal_network, body = self.network
        if not len(people):
            return empty_bodies("smpl")
        regions = [padded_region(box, 1.0, 1.0) for box in people.boxes]
        centres = np.array([r[0] for r in regions])
        sides = np.array([r[1][0] for r in regions])
        focal = (
            self._own_focal(image, focal_network)
            if focal_network is not None
            else math.sqrt(intrinsics.fx * intrinsics.fy)
        )
        # black outside the image
        crops = [
            resample_crop(image, crop_around_box(box, SIDE, SIDE, padding=1.0))
            for box in people.boxes
        ]
        pixels = np.concatenate(
            [normalized_nchw(one, IMAGENET_MEAN, IMAGENET_STD) for one in crops]
        )
        root, pose, betas, weak_camera = self.run(
            {"img": pixels, **camerahmr_inputs(centres, sides, focal, intrinsics)}
        )
        rotations = np.concatenate(
            [root.reshape(-1, 1, 3, 3), pose.reshape(len(root), -1, 3, 3)], axis=1
        )
        if rotations.shape[1] != 24:
            raise BackendError(
                f"CameraHMR returned {rotations.shape[1]} joints, where SMPL has 24: checkpoint "
                "and code of its SMPL-X branch are not supported"
            )
        transl = translation_from_crop(weak_camera.reshape(-1, 3), centres, sides, intrinsics)
        bodies = pose_smpl_bodies(body, rotations, betas, transl)
        return replace(
            bodies,
            observed=observed_joints(
                keypoints, image.shape[0], image.shape[1], self.options.seen_confidence
            ),
        )

    def run_network(self, inputs: dict[str, torch.Tensor]) -> Sequence[Any]:
        """Run the network: root (M, 1, 3, 3), pose (M, 23, 3, 3), betas (M, 10) and weak
        perspective (M, 3).
        """
        answer = self.network[0](inputs)
        try:
            return [
                *(answer[0][name] for name in ("global_orient", "body_pose", "betas")),
                answer[1],
            ]
        except (KeyError, TypeError, IndexError) as error:
            raise BackendError(
                f"CameraHMR returned {type(answer).__name__} without SMPL parameters or a camera: "
                f"use the checkout of {self.project.homepage}"
            ) from error

    def _own_focal(self, image: UInt8Array, network: Any) -> float:
        """Return the focal length in px that FLNet estimates from the photo."""
        if self.options.focal_channels == "bgr":
            image = np.ascontiguousarray(image[..., ::-1])
        square, _ = letterbox(image, SIDE, SIDE, fill=_WHITE, how="area")
        pixels = picture_tensor(square, IMAGENET_MEAN, IMAGENET_STD, device=self.device)
        with self.inference():
            fields = to_numpy(network(pixels)[0])
        vertical = float(fields.reshape(-1, 2)[0, 1])
        if not 0.02 < vertical < 3.1:
            raise BackendError(
                f"CameraHMR's FLNet sees an impossible vertical field of view of {vertical:.3g} rad"
            )
        return float(image.shape[0] / (2 * math.tan(vertical / 2)))
