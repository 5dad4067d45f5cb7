"""SAM 3D Body (Meta 2025) from its checkout: surfaces and keypoints of the MHR body, in metres, in the given camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.observed import observed_joints
from physic_core.adapters.pictures import check_photo
from physic_core.adapters.smpl import no_bodies, parameters_of
from physic_core.body.joints import JOINT_INDEX, NUM_JOINTS
from physic_core.devices import check_device
from physic_core.errors import BackendError, DeviceError
from physic_core.interfaces import BodyEstimator, Options
from physic_core.types import Bodies, Mesh
from physic_human.hosting import CheckoutOptions, Hosted, Project, SeenConfidence, batches, computing

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array

__all__ = ["JOINTS_OF_KEYPOINTS", "KEYPOINTS", "Sam3dBody", "Sam3dBodyOptions", "joints_of_keypoints"]

KEYPOINTS = 70
_CHECKPOINT, _MHR = "model.ckpt", "assets/mhr_model.pt"
_BODY = {"shoulder": 5, "elbow": 7, "hip": 9, "knee": 11, "ankle": 13}
"""First of the two keypoints, left then right, of what both bodies have."""
_EYES = {"left_eye": 1, "right_eye": 2}
_WRIST = {"left": 62, "right": 41}
_FIRST_FINGER = {"left": 42, "right": 21}
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_FOOT = {"left": (13, 15, 16), "right": (14, 18, 19)}
"""Ankle, and tips of the big and the small toe: the ball of the foot is a mean of them, and says how it is turned."""
_BALL = np.array([0.2, 0.4, 0.4], np.float32)
"""Weights of that mean: on worlds it is 5 mm off on average, and 31 mm with bent toes."""


def _table() -> dict[int, int]:
    """Keypoint -> joint of SMPL-X.

    Fingers come thumb first, each from its tip: tip, "first", "second", "third joint"; the third is the knuckle, and
    there SMPL-X begins to count. The neck is left out, for it is another point; so are olecranon, fossa and acromion.
    """
    table = {number: JOINT_INDEX[name] for name, number in _EYES.items()}
    for name, number in _BODY.items():
        table |= {number: JOINT_INDEX[f"left_{name}"], number + 1: JOINT_INDEX[f"right_{name}"]}
    for side, first in _FIRST_FINGER.items():
        table[_WRIST[side]] = JOINT_INDEX[f"{side}_wrist"]
        for i, finger in enumerate(_FINGERS):
            tip = first + 4 * i
            table |= {tip + 4 - k: JOINT_INDEX[f"{side}_{finger}{k}"] for k in (1, 2, 3)}
    return table


JOINTS_OF_KEYPOINTS = _table()
"""Which of the 70 keypoints is which joint of SMPL-X."""


def joints_of_keypoints(keypoints: FloatArray) -> FloatArray:
    """Keypoints (N, 70, 3) -> joints of SMPL-X (N, 55, 3) float32, NaN where MHR's keypoints say nothing."""
    joints = np.full((len(keypoints), NUM_JOINTS, 3), np.nan, np.float32)
    joints[:, list(JOINTS_OF_KEYPOINTS.values())] = keypoints[:, list(JOINTS_OF_KEYPOINTS)]
    for side, points in _FOOT.items():
        joints[:, JOINT_INDEX[f"{side}_foot"]] = np.einsum("k,nki->ni", _BALL, keypoints[:, list(points)])
    return joints


class Sam3dBodyOptions(CheckoutOptions):
    """Settings of SAM 3D Body."""

    weights: str = Field(
        default="sam-3d-body-dinov3",
        description="a name of `physic weights list`, or a folder with model.ckpt, model_config.yaml and "
        "assets/mhr_model.pt",
    )
    seen_confidence: SeenConfidence = 0.5
    use_masks: bool = Field(
        default=False, description="show the network the people's masks too; helps where people overlap"
    )


class Sam3dBody(Hosted, BodyEstimator):
    """MHR bodies: surface and joints say everything, the rotations are zero. Needs a GPU, for its code does."""

    Options: ClassVar[type[Options]] = Sam3dBodyOptions
    options: Sam3dBodyOptions
    capabilities = frozenset({"needs_cuda"})
    project: ClassVar[Project] = Project(
        "SAM 3D Body",
        "sam_3d_body",
        "https://github.com/facebookresearch/sam-3d-body",
        ("torchvision", "pytorch_lightning", "yacs", "roma", "einops", "timm"),
    )

    def load(self, device: str = "cpu") -> None:
        """Build the estimator and fill it.

        Raises:
            DeviceError: the device is not there, or is no GPU.
            WeightsMissingError: code or weights are missing.
            BackendError: they are not SAM 3D Body's.
        """
        check_device(device)
        if not device.startswith("cuda"):
            raise DeviceError(f"SAM 3D Body's own code runs on a GPU only, and '{device}' was asked for: use 'cuda'")
        self._build(device)

    def _build(self, device: str) -> None:
        checkpoint, mhr = self._host.file(_CHECKPOINT), self._host.file(_MHR)
        build = self._host.checkout.attribute("load_sam_3d_body")
        kind = self._host.checkout.attribute("SAM3DBodyEstimator")
        with computing(self._host.checkout, device):
            network, settings = build(str(checkpoint), device=device, mhr_path=str(mhr))
            self._host.network, self._host.device = kind(network, settings), device

    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """N people -> N bodies of the model "mhr", in metres in the camera frame.

        Raises:
            BackendError: it is not loaded, or it answers something else.
        """
        check_photo(image)
        estimator = self._host.loaded()
        if not len(people):
            return no_bodies("mhr", num_betas=0)
        found: list[dict[str, Any]] = []
        for rows in batches(len(people), self.options.batch):
            found += self._ask(estimator, image, people, rows, intrinsics)
        place = np.stack([np.asarray(one["pred_cam_t"], np.float32) for one in found])
        vertices = np.stack([np.asarray(one["pred_vertices"], np.float32) for one in found]) + place[:, None]
        points = np.stack([np.asarray(one["pred_keypoints_3d"], np.float32)[:KEYPOINTS] for one in found])
        zero = np.zeros((len(people), 22, 3), np.float32)
        betas = np.stack([np.asarray(one.get("shape_params", ()), np.float32).reshape(-1) for one in found])
        mesh = Mesh("mhr", vertices, np.asarray(estimator.faces, np.int32))
        return Bodies(
            parameters_of(zero, betas, place),
            "mhr",
            observed=observed_joints(keypoints, *image.shape[:2], self.options.seen_confidence),
            joints=joints_of_keypoints(points + place[:, None]),
            mesh=mesh,
        )

    def _ask(
        self, estimator: Any, image: UInt8Array, people: People, rows: slice, intrinsics: Intrinsics
    ) -> list[dict[str, Any]]:
        import torch

        boxes = np.asarray(people.boxes[rows], np.float32)
        with computing(self._host.checkout, self._host.device, half=self.options.half):
            answer = estimator.process_one_image(
                np.ascontiguousarray(image),  # RGB, as it wants arrays; only files it reads as BGR
                bboxes=boxes,
                masks=np.ascontiguousarray(people.masks[rows]) if self.options.use_masks else None,
                cam_int=torch.from_numpy(intrinsics.matrix.astype(np.float32))[None],
            )
        wanted = {"pred_vertices", "pred_cam_t", "pred_keypoints_3d"}
        if len(answer) != len(boxes) or not all(wanted <= one.keys() for one in answer):
            raise BackendError(
                f"SAM 3D Body answered {len(answer)} people for {len(boxes)} boxes, or one without "
                f"{', '.join(sorted(wanted))}: take the checkout of https://github.com/facebookresearch/sam-3d-body"
            )
        return list(answer)
