"""Estimate MHR bodies with InstantHMR (2026), small networks that were trained on bodies of SAM 3D
Body.

They return the parameters of a body, its place in a camera of their own, and, but for the newest,
70 keypoints in 3D. The principal point of that camera is the photo's centre. Its focal length is
the photo's diagonal. Files with ``cliff_focal`` in their metadata get the focal length as input,
and the box as angles. The place is converted to the pipeline's camera, where the hips project to
the same pixel and have the same size. Checked against instanthmr/inference.py of
mohamdev/InstantHMR at b29e7d7, and its description of ``--cliff-focal``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.bodies import SeenConfidence
from physic_core.body.joints import NUM_JOINTS, joint_pair
from physic_core.errors import BackendError
from physic_core.interfaces import BodyEstimator

from .mhr import MhrModel
from .one_graph import WEIGHTS_HELP, GraphSignature, OnnxBackend, OnnxBackendOptions, PortSpec
from .top_down import BatchOptions, crop_batch, run_batches

if TYPE_CHECKING:
    from physic_core.adapters.top_down import Crop
    from physic_core.types import (
        Bodies,
        FloatArray,
        Hints,
        Intrinsics,
        Keypoints,
        People,
        UInt8Array,
    )

    from .one_graph import LoadedGraph
    from .sessions import Network

SIDE = 224
"""Side of the crop, px, where the file leaves it free."""
MARGIN = 1.2
"""Side of the crop in longer sides of the person's box, as in the network's training."""
HIPS = joint_pair("hip")


class InstantHmrOptions(BatchOptions):
    """Settings of InstantHMR."""

    weights: str = Field("instanthmr", description=WEIGHTS_HELP)
    seen_confidence: SeenConfidence = 0.5
    mhr: str = Field(
        "",
        description="Meta's body model MHR, a name of `physic weights list` or the path of its "
        "mhr_model.pt: gives "
        "bodies their surface and rotations; empty: only joints, if the network returns them",
    )


class InstantHmr(OnnxBackend, BodyEstimator):
    """Body estimator: MHR bodies by InstantHMR, with mesh and rotations if the body model MHR is
    named.

    Without it, bodies are only joints, and all rotations are zero.
    """

    written_for = 1
    Options: ClassVar[type[OnnxBackendOptions]] = InstantHmrOptions
    options: InstantHmrOptions
    reads = ("people", "intrinsics", "keypoints")
    weight_options = ("weights", "mhr")
    _mhr: MhrModel | None = None
    signatures: ClassVar = {
        "a file of momolesang/InstantHMR": GraphSignature(
            (
                PortSpec("image", shape=(None, 3, None, None)),
                PortSpec("cliff_cond", shape=(None, 3)),
            ),
            (
                PortSpec("mhr_params", shape=(None, 204)),
                PortSpec("shape_params", shape=(None, 45)),
                PortSpec("cam_trans", shape=(None, 3)),
                PortSpec("joints_3d", shape=(None, 70, 3), optional=True),
            ),
        ),
    }

    def build(self, device: str) -> LoadedGraph:
        """Open the network, and the body model if one is named."""
        if self.options.mhr:
            self._mhr = MhrModel(self.file(option="mhr"), device)
        return super().build(device)

    def close(self) -> None:
        """Release network and body model."""
        super().close()
        self._mhr = None

    def match(self, network: Network) -> LoadedGraph:
        """Match an open network.

        Raises:
            BackendError: its form is unknown, or it returns no joints and no body model is named.
        """
        loaded = super().match(network)
        if not loaded.has_output("joints_3d") and not self.options.mhr:
            raise BackendError(
                f"{network.name} returns no joints_3d: its bodies follow from their parameters by "
                f"the body model MHR. "
                "Name it in the option mhr"
            )
        return loaded

    def infer(
        self,
        image: UInt8Array,
        people: People,
        intrinsics: Intrinsics,
        keypoints: Keypoints,
        hints: Hints,
    ) -> Bodies:
        """Return the MHR bodies of N people, metres, in the frame of the camera ``intrinsics``.

        Raises:
            BackendError: it is not loaded, or the network fails.
        """
        from physic_core.adapters.bodies import (
            empty_bodies,
            joints_from_mhr70,
            observed_joints,
            parameters_from_rotvecs,
        )
        from physic_core.types import Bodies, Mesh

        loaded = self.network
        if not len(people):
            return empty_bodies("mhr", num_betas=0)
        height, width = image.shape[:2]
        in_angles = loaded.network.metadata.get("cliff_focal", "false").lower() == "true"
        focal = intrinsics.fy if in_angles else math.hypot(height, width)
        stated = loaded.input_shape("image")[2]
        side = stated if isinstance(stated, int) else SIDE
        feed = {
            "image": crop_batch(image, [square_crop(box, side) for box in people.boxes]),
            "cliff_cond": box_condition(people.boxes, height, width, focal if in_angles else None),
        }
        names = ["mhr_params", "shape_params", "cam_trans"]
        names += ["joints_3d"] if loaded.has_output("joints_3d") else []
        parameters, shape, place, *points = run_batches(loaded, feed, names, self.options.batch)
        posed = None if self._mhr is None else self._mhr.pose(shape, parameters)
        joints = (
            joints_from_mhr70(points[0])
            if points
            else np.full((len(people), NUM_JOINTS, 3), np.nan, np.float32)
        )
        if not points and posed is not None:
            joints = posed.joints
        hips = joints[:, list(HIPS)].mean(axis=1)
        transl = move_to_camera(place + hips, focal, height, width, intrinsics) - hips
        mesh = None
        rotvecs = np.zeros((len(people), 22, 3), np.float32)
        if posed is not None and self._mhr is not None:
            mesh = Mesh("mhr", posed.vertices + transl[:, None], self._mhr.faces)
            rotvecs = posed.rotvecs
        return Bodies(
            parameters_from_rotvecs(rotvecs, shape, transl),
            "mhr",
            observed=observed_joints(keypoints, height, width, self.options.seen_confidence),
            joints=joints + transl[:, None].astype(np.float32),
            mesh=mesh,
            tpose_rotations=posed is not None,
        )


def square_crop(box: FloatArray, side: int = SIDE) -> Crop:
    """Return the crop of a person's box (4,), as InstantHMR cuts it: its edges are rounded outwards
    to whole pixels.
    """
    from physic_core.adapters.top_down import Crop, padded_region

    middle, size = padded_region(box, 1.0, MARGIN)
    low = np.floor(middle + 0.5 - size / 2)
    step = (np.ceil(middle + 0.5 + size / 2) - low) / side
    origin = low + step / 2 - 0.5
    return Crop((float(origin[0]), float(origin[1])), (float(step[0]), float(step[1])), side, side)


def box_condition(
    boxes: FloatArray, height: int, width: int, focal: float | None = None
) -> FloatArray:
    """Return the centre of N boxes, -1 to 1 across the photo, and their longer side over the
    photo's: (N, 3).

    With a focal length in px, the angles of the centre from the middle of the photo, and the side
    in focal lengths.
    """
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    side = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
    if focal is not None:
        angles = np.arctan((middle - np.array([width, height]) / 2) / focal)
        return np.column_stack([angles, side / focal]).astype(np.float32)
    return np.column_stack([2 * middle / [width, height] - 1, side / max(width, height)]).astype(
        np.float32
    )


def move_to_camera(
    points: FloatArray, focal: float, height: int, width: int, camera: Intrinsics
) -> FloatArray:
    """Convert points (N, 3) from the network's camera to another one, at the same pixel and with
    the same size there.

    Args:
        points: metres in a camera with the focal length ``focal`` in px, and the principal point in
            the photo's centre.
        focal: px.
        height: of the photo, px.
        width: of the photo, px.
        camera: the other one.

    Returns:
        (N, 3) metres; NaN for points that are not in front of the camera.
    """
    x, y, z = np.where(points[:, 2:] > 0, points, np.nan).astype(np.float64).T
    depth = z * math.sqrt(camera.fx * camera.fy) / focal
    column = focal * x / z + (width - 1) / 2
    row = focal * y / z + (height - 1) / 2
    found: FloatArray = np.column_stack(
        [(column - camera.cx) / camera.fx * depth, (row - camera.cy) / camera.fy * depth, depth]
    )
    return found
