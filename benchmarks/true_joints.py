"""Fit bodies to true joints with errors of a known size, and print what the fit and the result make
of them.

    python -m benchmarks.true_joints DATA [--photos N] [--errors-mm 0 25 50]

It runs the embedded preset on the photos of DATA/mpi_inf_3dhp with their cameras. In place of the
keypoints, the person has the true places of twelve joints in the picture, and in 3D the true joints
with independent normal errors, whose mean length is given. The detector states both errors, as a
stronger pose network would. Each row has the medians over people of PA-MPJPE, mm: of the given
joints, of the body of the fit, and of the result.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physic_bench.joints import BODY_ROWS, HIPS, LIMB_JOINTS, limb_joints
from physic_core import Pipeline, load_config
from physic_core.adapters.people import box_iou
from physic_core.body import load_body
from physic_core.body.convert.bodies import replace_mesh_with_joints
from physic_core.errors import PhysicError
from physic_core.interfaces import KeypointDetector
from physic_core.metrics import pa_mpjpe_mm
from physic_core.types import Bodies, CameraTrust, Intrinsics, Keypoints, skeleton_named
from physic_embedded.body_fit.observations import rotation_to_ray

from .truth.measures import MIN_IOU, box_of
from .truth.sets import SETS, Sample, picture_of

if TYPE_CHECKING:
    from physic_core.pipeline.estimate import Estimates
    from physic_core.types import FloatArray, People, UInt8Array

MEAN_OF_NORM = math.sqrt(8 / math.pi)
"""Mean length of a vector of three standard normal numbers."""

POINT_SIGMA_PX = 1.0
LEAST_DEPTH_SIGMA_M = 0.01
"""Stated for joints without errors: those of the body are not quite the joints of the data set."""


class TrueJoints(KeypointDetector):
    """Keypoint detector that gives the joints of one person, in place of those that a picture
    shows.

    Args:
        points: (12, 2) px, the true places of :data:`LIMB_JOINTS`, in a photo of this width.
        width: px.
        joints: (12, 3) metres in the camera frame, with their errors.
        ray: (3,) from the camera to the middle of the hips.
        depth_sigma: metres.
    """

    written_for = 1

    def __init__(
        self,
        points: FloatArray,
        width: int,
        joints: FloatArray,
        ray: FloatArray,
        depth_sigma: float,
    ) -> None:
        super().__init__()
        self.points = points
        self.width = width
        self.depth_sigma = depth_sigma
        self.world = (joints - joints[HIPS].mean(0)) @ rotation_to_ray(ray)

    def infer(self, image: UInt8Array, people: People) -> Keypoints:
        """Return the joints for the person at their place, and confidence 0 for all others."""
        names = skeleton_named("coco17").names
        seen = (self.points + 0.5) * image.shape[1] / self.width - 0.5  # large photos are reduced
        columns = [names.index(name) for name in LIMB_JOINTS]
        count = len(people)
        points = np.zeros((count, len(names), 2))
        world = np.zeros((count, len(names), 3))
        confidence = np.zeros((count, len(names)))
        overlap = box_iou(people.boxes, box_of(np.asarray(seen, np.float64))[None])[:, 0]
        if count and overlap.max() >= MIN_IOU:
            person = int(overlap.argmax())
            points[person, columns], world[person, columns], confidence[person, columns] = (
                seen,
                self.world,
                1.0,
            )
        sigma = np.full(confidence.shape, POINT_SIGMA_PX)
        depth_sigma = np.full(confidence.shape, self.depth_sigma)
        return Keypoints(
            points, confidence, "coco17", world=world, sigma=sigma, depth_sigma=depth_sigma
        )


def main() -> int:
    """Print one row for each size of the errors."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.true_joints", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("data", type=Path, help="folder with mpi_inf_3dhp")
    parser.add_argument(
        "--photos", type=int, metavar="N", help="the first N photos; all by default"
    )
    parser.add_argument(
        "--errors-mm", type=float, nargs="+", default=[0.0, 25.0, 50.0], metavar="E"
    )
    given = parser.parse_args()
    if not (given.data / "mpi_inf_3dhp").is_dir():
        print(f"skipped: there is no {given.data / 'mpi_inf_3dhp'}", file=sys.stderr)
        return 0
    samples = SETS["mpi_inf_3dhp"](given.data / "mpi_inf_3dhp")[: given.photos]
    for error_mm in given.errors_mm:
        rows = [
            found
            for k, sample in enumerate(samples)
            if (found := errors_of(sample, error_mm, k)) is not None
        ]
        given_mm, body, final = np.median(rows, 0) if rows else [math.nan] * 3
        print(
            f"{error_mm:.0f} mm: {len(rows)} people, joints {given_mm:.0f}, body {body:.0f}, "
            f"result {final:.0f} mm",
            flush=True,
        )
    return 0


def errors_of(sample: Sample, error_mm: float, seed: int) -> list[float] | None:
    """Return PA-MPJPE, mm, of given joints, body and result of one photo; None if its person has no
    body.
    """
    truth = limb_joints(sample.truth["joints"], 3)
    rng = np.random.default_rng(seed)
    sigma = error_mm / 1000 / MEAN_OF_NORM
    joints = truth + rng.normal(scale=sigma, size=truth.shape) if sigma else truth
    image = picture_of(sample)[..., ::-1]
    height, width = image.shape[:2]
    pixels = truth @ np.asarray(sample.K).T
    detector = TrueJoints(
        pixels[:, :2] / pixels[:, 2:],
        width,
        joints,
        truth[HIPS].mean(0),
        max(sigma, LEAST_DEPTH_SIGMA_M),
    )
    (fx, _, cx), (_, fy, cy) = np.asarray(sample.K)[:2]
    camera = Intrinsics(fx, fy, cx, cy, width, height, CameraTrust.KNOWN)
    kept: list[Bodies] = []

    def complete(found: Estimates) -> Estimates:
        kept.append(found.bodies)
        return found

    try:
        with Pipeline(
            load_config(preset="embedded"), backends={"keypoint_detector": detector}
        ) as pipeline:
            result = pipeline(np.ascontiguousarray(image), intrinsics=camera, complete=complete)
    except PhysicError as error:
        print(f"{sample.name}: {error}", file=sys.stderr)
        return None
    boxes = (
        np.array([person.box for person in result.people]).reshape(-1, 4)
        * width
        / result.image.shape[1]
    )
    overlap = box_iou(boxes, box_of(np.asarray(detector.points, np.float64))[None])[:, 0]
    if not len(boxes) or overlap.max() < MIN_IOU:
        return None
    person = int(overlap.argmax())
    fitted = np.asarray(
        replace_mesh_with_joints(kept[0], load_body("embedded")).joints, np.float64
    )[person]
    final = np.asarray(result.people[person].joints, np.float64)
    return [float(pa_mpjpe_mm(own, truth)) for own in (joints, fitted[BODY_ROWS], final[BODY_ROWS])]


if __name__ == "__main__":
    sys.exit(main())
