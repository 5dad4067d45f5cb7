"""Find in which frame of reference results are, by projecting them into the picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from physic_bench.projection import body_box, box_of_points, person_points, project
from physic_bench.wording import counted
from physic_core.adapters.detections import box_iou
from physic_core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_bench.cameras import Camera
    from physic_bench.contract import Frame, Prediction, Truth

    Array = NDArray[np.float64]

MIN_OVERLAP = 0.3
"""Median overlap of boxes of results that are in the frame that is assumed. Wrong axes or units give less than .1."""

ALTERNATIVES: Mapping[str, tuple[str, Callable[[Array, Camera], Array]]] = {
    "camera": ("OpenCV camera: x right, y down, z forward, m", lambda points, camera: points),
    "y-up": ("OpenGL camera: x right, y up, z backward, m", lambda points, camera: points * [1.0, -1.0, -1.0]),
    "y-up-forward": ("x left, y up, z forward, m", lambda points, camera: points * [-1.0, -1.0, 1.0]),
    "mirrored": ("mirror image of the OpenCV camera's", lambda points, camera: points * [-1.0, 1.0, 1.0]),
    "millimetres": ("OpenCV camera, mm", lambda points, camera: 0.001 * points),
    "world": ("world of the data set, m", lambda points, camera: camera.in_camera(points)),
    "inverse-camera": (
        "moved by the inverse of the camera's transform",
        lambda points, camera: camera.in_world(points),
    ),
}
"""Name -> description, and the transform of points (n, 3) into the OpenCV camera frame, metres."""


@dataclass(frozen=True)
class FrameCheck:
    """How well results fit their pictures, read as each alternative.

    Attributes:
        frame: name of the alternative that fits.
        overlap: alternative -> median intersection over union of boxes; empty without an annotated person.
        frames: number of frames compared.
    """

    frame: str
    overlap: Mapping[str, float]
    frames: int

    def sentence(self) -> str:
        """Return the decision as one sentence."""
        name = ALTERNATIVES[self.frame][0]
        if not self.overlap:
            return f"read as {name}; not checked: no frame has a result and an annotated person"
        value = self.overlap[self.frame]
        return f"read as {name}; median overlap of the projected boxes {value:.2f} over {counted(self.frames, 'frame')}"


def into_camera(prediction: Prediction, frame: Frame, alternative: str) -> Prediction:
    """Return a prediction with its people and scene moved from a frame of reference into the camera's."""
    if alternative == "camera":
        return prediction
    camera, move = frame.camera, ALTERNATIVES[alternative][1]

    def moved(points: Array | None) -> Array | None:
        return None if points is None else move(points, camera)

    people = tuple(replace(p, vertices=moved(p.vertices), joints=moved(p.joints)) for p in prediction.people)
    return replace(prediction, people=people, scene_points=moved(prediction.scene_points))


def _is_of_human_size(points: Array) -> bool:
    """Projection does not see a scale: a body in millimetres covers the same pixels as one in metres."""
    known = points[np.isfinite(points).all(-1)]
    return len(known) > 1 and 0.2 < float(np.ptp(known, axis=0).max()) < 3.0


def check_frame(samples: Sequence[tuple[Frame, Truth, Prediction]], method: str) -> FrameCheck:
    """Project some results by each alternative, and compare the boxes with those of the annotated people.

    Results that fit the OpenCV camera are read so, others by the alternative that fits best.

    Args:
        samples: frames with truth and result, as they are in the files.
        method: for messages.

    Raises:
        InputError: the results fit by no alternative.
    """
    found: dict[str, list[float]] = {name: [] for name in ALTERNATIVES}
    count = 0
    for frame, truth, prediction in samples:
        boxes = [box for person in truth.people if (box := body_box(person, frame.camera.K)) is not None]
        if not boxes or not prediction.people:
            continue
        count += 1
        K = frame.camera.K if prediction.K is None else prediction.K
        for name, (_, move) in ALTERNATIVES.items():
            moved = [move(person_points(person), frame.camera) for person in prediction.people]
            own = [box_of_points(project(points, K)) for points in moved if _is_of_human_size(points)]
            known = np.array([box for box in own if box is not None]).reshape(-1, 4)
            found[name] += box_iou(np.array(boxes), known).max(1, initial=0.0).tolist()
    overlap = {name: median(values) for name, values in found.items() if values}
    best = "camera"
    if overlap and overlap[best] < MIN_OVERLAP:
        best = max(overlap, key=lambda name: overlap[name])
    if overlap and overlap[best] < MIN_OVERLAP:
        raise InputError(
            f"the results of {method} do not project onto the annotated people in any frame of reference: median "
            f"overlap of the boxes {overlap[best]:.2f} over {counted(count, 'frame')}, if read as "
            f"{ALTERNATIVES[best][0]}; check that they are of these pictures"
        )
    return FrameCheck(best, overlap, count)
