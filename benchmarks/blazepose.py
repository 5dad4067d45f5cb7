"""BlazePose's own 3D landmarks, placed by their projection, on photos with measured truth.

    python -m benchmarks blazepose DATA [--sets mpi_inf_3dhp,panoptic,roundtable] [--photos N]

What a user has without this project: MediaPipe's heavy landmark model, whose 33 landmarks in metres
are moved so that they project onto its own keypoints (OpenCV's SQPNP with the known camera). People
are those of the embedded preset, with the same looks at each. The table is that of ``truth``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from physic_bench.scoring import LIMB_JOINTS
from physic_core.body import NUM_JOINTS
from physic_embedded.keypoint_detector import EmbeddedKeypoints
from physic_embedded.segmenter import EmbeddedSegmenter

from .fits import parser_of
from .truth.command import samples_of
from .truth.joints import BODY_ROWS
from .truth.scores import compared
from .truth.sets import Sample, picture_of
from .truth.table import CAMERA_SETS, rows_of, text_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import Keypoints, People

    Array = NDArray[np.float64]

SEEN = 0.5
"""Least confidence of landmarks that place a person."""

_FEWEST = 6  # landmarks; with fewer, all place the person


def main() -> None:
    """Run, compare, print."""
    parser = parser_of("blazepose", __doc__, fits=False)
    parser.add_argument("data", type=Path, help="folder that holds the data sets")
    parser.add_argument("--sets", default=",".join(CAMERA_SETS), help="with commas between them")
    parser.add_argument("--photos", type=int, help="the first N of each data set")
    given = parser.parse_args()
    samples = samples_of([given.data], given.sets.split(","), given.photos)
    segmenter, detector = EmbeddedSegmenter(), EmbeddedKeypoints()
    segmenter.load()
    detector.load()
    answers = []
    for sample in samples:
        picture = np.ascontiguousarray(picture_of(sample)[..., ::-1])
        people = segmenter.infer(picture)
        answers.append(answer_of(people, detector.infer(picture, people), sample))
    rows = rows_of(compared(samples, answers))
    of_joints = [row for row in rows if re.search("mm|pelvis", row.figure.name)]
    print(text_table(of_joints))


def answer_of(people: People, keypoints: Keypoints, sample: Sample) -> dict[str, Any]:
    """Return what ``truth`` measures of an answer that is landmarks alone."""
    names = keypoints.joint_set.names
    rows = [names.index(name) for name in LIMB_JOINTS]
    confidence = keypoints.confidence[:, rows, None]
    limbs = np.concatenate([keypoints.points[:, rows], confidence], -1)
    assert keypoints.world is not None
    told = []
    for i, box in enumerate(people.boxes):
        place = placed(keypoints.world[i], keypoints.points[i], keypoints.confidence[i], sample.K)
        joints = np.full((NUM_JOINTS, 3), np.nan)
        joints[BODY_ROWS] = place[rows]
        told.append({"box": box, "joints": joints, "keypoints": limbs[i], "usable": []})
    return {"error": "", "people": told, "floor": None}


def placed(world: Array, points: Array, confidence: Array, K: Array) -> Array:
    """Return landmarks (J, 3) in metres in the frame of a camera (3, 3) px, before which they
    project onto points (J, 2) px with this confidence (J,).
    """
    is_visible = confidence >= SEEN
    if is_visible.sum() < _FEWEST:
        is_visible[:] = True
    _, turn, move = cv2.solvePnP(
        world[is_visible].astype(float),
        points[is_visible].astype(float),
        K,
        None,
        flags=cv2.SOLVEPNP_SQPNP,
    )
    return np.asarray(world @ cv2.Rodrigues(turn)[0].T + move[:, 0])
