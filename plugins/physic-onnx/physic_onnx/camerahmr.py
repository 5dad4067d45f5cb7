"""Estimate SMPL bodies with CameraHMR (Patel and Black 2025) from an ONNX file that a licensed user exported.

``python -m physic_onnx.export camerahmr`` writes the file. The camera is the pipeline's, so FLNet, which estimates one,
is not needed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from physic_core.adapters.observed import SeenConfidence
from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator

from .contract import GraphSignature, PortSpec
from .one_graph import WEIGHTS_HELP, OnnxBackend, OnnxBackendOptions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.adapters.crops import Crop
    from physic_core.types import Bodies, FloatArray, Hints, Intrinsics, Keypoints, Mesh, People, UInt8Array

    from .one_graph import LoadedGraph

__all__ = ["CameraHmr", "CameraHmrOptions"]

SIDE = 256
"""Side of the square crop, px; the network uses its middle 192 columns."""


class CameraHmrOptions(OnnxBackendOptions):
    """Settings of CameraHMR."""

    weights: str = Field("camerahmr-onnx", description=WEIGHTS_HELP)
    margin: float = Field(
        1.0, ge=0.5, le=3, description="side of the crop in longer sides of the person's box; 1 as in CameraHMR's demo"
    )
    channels: Literal["rgb", "bgr"] = Field(
        "rgb",
        description="order in which the network sees colours: it was trained on RGB; 'bgr' repeats a mistake of its "
        "later demo, to compare",
    )
    batch: int = Field(4, ge=1, le=1024, description="people a run, where the file leaves that free")
    seen_confidence: SeenConfidence = 0.5


class CameraHmr(OnnxBackend, BodyEstimator):
    """Body estimator: SMPL bodies by CameraHMR with joints, and with a mesh if the ONNX file returns one."""

    Options: ClassVar[type[OnnxBackendOptions]] = CameraHmrOptions
    options: CameraHmrOptions
    signatures: ClassVar = {
        "physic_onnx.export camerahmr": GraphSignature(
            (
                PortSpec("img", ("image", "input"), shape=(None, 3, SIDE, SIDE)),
                PortSpec("box_center", ("box_centre",), shape=(None, 2)),
                PortSpec("box_size", shape=(None,)),
                PortSpec("img_size", shape=(None, 2)),
                PortSpec("cam_int", shape=(None, 3, 3)),
            ),
            (
                PortSpec("global_orient", shape=(None, 1, 3, 3)),
                PortSpec("body_pose", shape=(None, 23, 3, 3)),
                PortSpec("betas", shape=(None, None)),
                PortSpec("pred_cam", shape=(None, 3)),
                PortSpec("joints", shape=(None, 24, 3)),
                PortSpec("vertices", shape=(None, None, 3), optional=True),
                PortSpec("faces", dtype=("int64", "int32"), shape=(None, 3), optional=True),
                PortSpec("rest", shape=(None, 3), optional=True),
            ),
        ),
    }

    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """Return the SMPL bodies of N people, metres, in the frame of the camera ``intrinsics``.

        Raises:
            BackendError: it is not loaded, or the network fails.
        """

        from physic_core.adapters.crop_camera import camerahmr_inputs, translation_from_crop
        from physic_core.adapters.crops import crop_around_box
        from physic_core.adapters.observed import observed_joints
        from physic_core.adapters.smpl import bodies_from_smpl, empty_bodies

        from .top_down import crop_batch, run_batches

        loaded = self.loaded()
        if not len(people):
            return empty_bodies("smpl")
        crops = [crop_around_box(box, SIDE, SIDE, padding=self.options.margin, grid="halves") for box in people.boxes]
        centres, sides = _regions(crops)
        feed = {
            "img": crop_batch(image, crops, bgr=self.options.channels == "bgr"),
            **camerahmr_inputs(centres, sides, math.sqrt(intrinsics.fx * intrinsics.fy), intrinsics),
        }
        surface = loaded.has_output("vertices") and loaded.has_output("faces")
        names = ["global_orient", "body_pose", "betas", "pred_cam", "joints", *(["vertices"] if surface else [])]
        orient, pose, betas, weak, joints, *vertices = run_batches(loaded, feed, names, self.options.batch)
        if weak.shape != (len(people), 3) or joints.shape[1:] != (24, 3):
            raise BackendError(
                f"{loaded.network.name} returned pred_cam {weak.shape} and joints {joints.shape}: "
                f"({len(people)}, 3) and ({len(people)}, 24, 3) were expected"
            )
        transl = translation_from_crop(weak, centres, sides, intrinsics)
        mesh = _mesh(loaded, feed, vertices[0] + transl[:, None]) if vertices else None
        rotations = np.concatenate([orient.reshape(-1, 1, 3, 3), pose], axis=1)
        bodies = bodies_from_smpl(rotations, betas, transl, joints=joints + transl[:, None], mesh=mesh)
        return replace(
            bodies, observed=observed_joints(keypoints, image.shape[0], image.shape[1], self.options.seen_confidence)
        )


def _regions(crops: list[Crop]) -> tuple[FloatArray, FloatArray]:
    """Return centre (N, 2) and side (N,) of each crop, photo px."""

    middles = np.stack([crop.to_photo(np.array([SIDE / 2, SIDE / 2])) for crop in crops])
    return middles, np.array([SIDE * crop.step[0] for crop in crops])


def _mesh(loaded: LoadedGraph, feed: dict[str, NDArray[Any]], vertices: FloatArray) -> Mesh:
    """Return the mesh of the bodies."""
    from physic_core.types import Mesh

    from .top_down import constant_outputs

    names = ["faces", *(["rest"] if loaded.has_output("rest") else [])]
    faces, *rest = constant_outputs(loaded, feed, names)
    return Mesh("smpl", vertices.astype(np.float32), faces.astype(np.int64), rest[0] if rest else None)
