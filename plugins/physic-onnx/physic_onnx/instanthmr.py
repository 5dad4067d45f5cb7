"""Estimate MHR bodies with InstantHMR (2026), a small network that was trained on bodies of SAM 3D Body.

It returns 70 keypoints in 3D and their place in a camera of its own: the focal length is the photo's diagonal, the
principal point is the photo's centre. The place is converted to the pipeline's camera, where the hips project to the
same pixel and have the same size. Checked against instanthmr/inference.py of mohamdev/InstantHMR at b29e7d7.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.bodies import SeenConfidence
from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator

from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackend, OnnxBackendOptions, PortSpec
from .top_down import BatchOptions

if TYPE_CHECKING:
    from physic_core.adapters.top_down import Crop
    from physic_core.types import Bodies, FloatArray, Hints, Intrinsics, Keypoints, People, UInt8Array

    from .one_graph import LoadedGraph
    from .sessions import Network

SIDE = 224
"""Side of the crop, px."""
MARGIN = 1.2
"""Side of the crop in longer sides of the person's box, as in the network's training."""
HIPS = (9, 10)
"""Keypoints of the hip joints."""


class InstantHmrOptions(BatchOptions):
    """Settings of InstantHMR."""

    weights: str = Field("instanthmr", description=WEIGHTS_HELP)
    seen_confidence: SeenConfidence = 0.5


class InstantHmr(OnnxBackend, BodyEstimator):
    """Body estimator: MHR bodies by InstantHMR, as joints without a mesh; all rotations are zero."""

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = InstantHmrOptions
    options: InstantHmrOptions
    reads = ("people", "intrinsics", "keypoints")
    signatures: ClassVar = {
        "instanthmr.onnx of momolesang/InstantHMR": GraphSignature(
            (
                PortSpec("image", shape=(None, 3, SIDE, SIDE)),
                PortSpec("cliff_cond", shape=(None, 3)),
            ),
            (
                PortSpec("shape_params", shape=(None, 45)),
                PortSpec("cam_trans", shape=(None, 3)),
                PortSpec("joints_3d", shape=(None, 70, 3)),
            ),
        ),
    }

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network, which must not be trained with the focal length as an input."""
        if network.metadata.get("cliff_focal", "false").lower() == "true":
            raise BackendError(
                f"{network.name} was trained with boxes in units of the focal length (cliff_focal in its metadata), "
                "which this backend does not feed: take instanthmr.onnx of huggingface.co/momolesang/InstantHMR"
            )
        return super().match(network)

    def infer(
        self, image: UInt8Array, people: People, intrinsics: Intrinsics, keypoints: Keypoints, hints: Hints
    ) -> Bodies:
        """Return the MHR bodies of N people, metres, in the frame of the camera ``intrinsics``.

        Raises:
            BackendError: it is not loaded, or the network fails.
        """
        from physic_core.adapters.bodies import (
            MHR_KEYPOINTS,
            empty_bodies,
            joints_from_mhr70,
            observed_joints,
            parameters_from_rotvecs,
        )
        from physic_core.types import Bodies

        from .top_down import crop_batch, run_batches

        loaded = self.network
        if not len(people):
            return empty_bodies("mhr", num_betas=0)
        feed = {
            "image": crop_batch(image, [square_crop(box) for box in people.boxes]),
            "cliff_cond": box_condition(people.boxes, image.shape[0], image.shape[1]),
        }
        shape, place, points = run_batches(loaded, feed, ["shape_params", "cam_trans", "joints_3d"], self.options.batch)
        if place.shape[1:] != (3,) or points.shape[1:] != (MHR_KEYPOINTS, 3):
            raise BackendError(
                f"{loaded.network.name} returned cam_trans {place.shape} and joints_3d {points.shape}: "
                f"({len(people)}, 3) and ({len(people)}, {MHR_KEYPOINTS}, 3) were expected"
            )
        hips = points[:, list(HIPS)].mean(axis=1)
        transl = move_to_camera(place + hips, image.shape[0], image.shape[1], intrinsics) - hips
        return Bodies(
            parameters_from_rotvecs(np.zeros((len(people), 22, 3), np.float32), shape, transl),
            "mhr",
            observed=observed_joints(keypoints, image.shape[0], image.shape[1], self.options.seen_confidence),
            joints=joints_from_mhr70(points + transl[:, None]),
        )


def square_crop(box: FloatArray) -> Crop:
    """Return the crop of a person's box (4,), as InstantHMR cuts it: its edges are rounded outwards to whole pixels."""
    from physic_core.adapters.top_down import Crop, padded_region

    middle, size = padded_region(box, 1.0, MARGIN)
    low = np.floor(middle + 0.5 - size / 2)
    step = (np.ceil(middle + 0.5 + size / 2) - low) / SIDE
    origin = low + step / 2 - 0.5
    return Crop((float(origin[0]), float(origin[1])), (float(step[0]), float(step[1])), SIDE, SIDE)


def box_condition(boxes: FloatArray, height: int, width: int) -> FloatArray:
    """Return the centre of N boxes, -1 to 1 across the photo, and their longer side over the photo's: (N, 3)."""
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    side = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
    return np.column_stack([2 * middle / [width, height] - 1, side / max(width, height)]).astype(np.float32)


def move_to_camera(points: FloatArray, height: int, width: int, camera: Intrinsics) -> FloatArray:
    """Convert points (N, 3) from the network's camera to another one, at the same pixel and with the same size there.

    NaN for points that are not in front of the camera.
    """
    x, y, z = np.where(points[:, 2:] > 0, points, np.nan).astype(np.float64).T
    focal = math.hypot(height, width)
    depth = z * math.sqrt(camera.fx * camera.fy) / focal
    column, row = focal * x / z + (width - 1) / 2, focal * y / z + (height - 1) / 2
    found: FloatArray = np.column_stack(
        [(column - camera.cx) / camera.fx * depth, (row - camera.cy) / camera.fy * depth, depth]
    )
    return found
