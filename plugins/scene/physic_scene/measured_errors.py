"""Sizes of the errors of single photos, as measured on synthetic worlds: ``measured_errors.json``.

The file states the worlds that it was measured on, and the script that wrote it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SIDES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from physic_core.types import FloatArray, IntArray

FILE = "measured_errors.json"

_CLASSES = {
    "head": ("nose", "eye", "ear", "mouth", "head"),
    "shoulder": ("shoulder", "neck"),
    "elbow": ("elbow",),
    "hand": ("wrist", "hand", "thumb", "index", "middle", "ring", "pinky"),
    "hip": ("hip", "pelvis"),
    "knee": ("knee",),
    "foot": ("ankle", "heel", "foot", "big_toe", "small_toe"),
}


@dataclass(frozen=True)
class MeasuredErrors:
    """Content of ``measured_errors.json``.

    Attributes:
        source: what they were measured on.
        confidence: (n,) of keypoints, increasing.
        keypoint: (n,) standard deviation of a keypoint of this confidence, as a share of the
            stature in px.
        keypoint_correlation: of two keypoints of a cluster.
        landmark_m: class of keypoint -> standard deviations (along, across) the line of sight.
        turn_deg: standard deviation of a body's turn about the line of sight, and about each axis
            across it.
        bone: of the logarithm of a bone's length, up to the stature.
        floor_deg: of a floor's normal about each of two axes.
        focal: of the logarithm of an estimated focal length: the part that the photos of a moment
            share, and the own.
    """

    source: str
    confidence: Sequence[float]
    keypoint: Sequence[float]
    keypoint_correlation: float
    landmark_m: Mapping[str, Sequence[float]]
    turn_deg: Sequence[float]
    bone: float
    floor_deg: float
    focal: Sequence[float]

    def keypoint_sigma(self, confidence: FloatArray) -> FloatArray:
        """Return the standard deviation (...) of keypoints of a confidence (...), as a share of the
        stature in px.
        """
        return np.interp(confidence, self.confidence, self.keypoint)

    def of(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return two numbers for each keypoint of a skeleton.

        Returns:
            Factor (J,) on the information of a detected keypoint: those of a cluster have a part of
            their errors in common. Standard deviations (J, 2) of a landmark on a single photo's
            body along the line of sight and about each axis across it, metres, up to the body's
            place and turn.
        """
        cluster = keypoint_clusters(names)
        size = np.bincount(cluster)[cluster]
        sigmas = np.array([self.landmark_m[keypoint_class(name)] for name in names])
        return 1 / (1 + (size - 1) * self.keypoint_correlation), sigmas


def keypoint_class(name: str) -> str:
    """Return the class of a keypoint, such as "hand" for "left_index1"; "head" for names of no
    class.
    """
    side, _, point = name.partition("_")
    point = point if side in SIDES else name
    return next((kind for kind, starts in _CLASSES.items() if point.startswith(starts)), "head")


def keypoint_clusters(names: Sequence[str]) -> IntArray:
    """Return the number (J,) of the cluster of each keypoint: those of one class and, but for the
    head, one side.
    """
    side = [name.partition("_")[0] if name.startswith(SIDES) else "" for name in names]
    keys = [
        (kind, "" if kind == "head" else s)
        for s, kind in zip(side, map(keypoint_class, names), strict=True)
    ]
    order = sorted(set(keys))
    return np.array([order.index(key) for key in keys])


@cache
def measured_errors() -> MeasuredErrors:
    """Return the content of the file."""
    content = json.loads(files("physic_scene").joinpath(FILE).read_text("utf-8"))
    return MeasuredErrors(**content)
