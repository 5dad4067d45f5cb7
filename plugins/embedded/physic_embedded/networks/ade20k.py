"""Label surfaces with DeepLabv3 on MobileNetV2, trained on the 31 most frequent classes of
ADE20K.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from physic_core.types import SURFACE_NAMES, SurfaceLabels
from physic_networks.pictures import letterbox

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, UInt8Array
    from physic_networks.onnx_sessions import OnnxSession
    from physic_networks.pictures import Resampling


_FRAMED = (23, 28)  # painting, mirror
_LEAST_PROBABILITY = 0.5  # pixels whose best surface is less probable are "unknown"

INPUT_SIZE = 512
STRIDE = 4
"""Logit i lies at pixel ``STRIDE * i`` of the input, as the network's own resizing to 512 px has
it.
"""
PADDING_VALUE = 127

ADE20K_CLASSES = {
    "floor": (4,),  # floor
    "ground": (7, 10, 12, 14, 30),  # road, grass, sidewalk, earth, field
    "rug": (29,),
    "wall": (1, 2, 15, 19, 23, 26, 28),  # wall, building, door, curtain, painting, house, mirror
    "ceiling": (6,),
    "window": (9,),
    "seat": (20, 24, 31),  # chair, sofa, armchair
    "bed": (8,),
    "table": (16,),
    "cabinet": (11, 25),  # cabinet, shelf
    "vehicle": (21,),  # car
    "vegetation": (5, 18),  # tree, plant
    "water": (22, 27),  # water, sea
    "sky": (3,),
    "object": (17,),  # mountain
    "person": (13,),
}
"""Name in :data:`SURFACE_NAMES` -> classes of ADE20K, numbered from 1 as in its list of 150.

Class 0 is not a class.
"""


def predict_surfaces(
    session: OnnxSession, image: UInt8Array
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Predict the probability of each surface, and of a painting or mirror, on a grid.

    Args:
        session: of ``deeplabv3_mnv2_ade20k``.
        image: (H, W, 3) uint8 RGB.

    Returns:
        Probabilities (h, w, S) float32 in the order of :data:`SURFACE_NAMES`, and (h, w) of a
        painting or mirror; the longer of h and w is 128. And the affine map (2, 3) from pixels of
        the image to cells of this grid.
    """
    how: Resampling = "area" if max(image.shape[:2]) > INPUT_SIZE else "bilinear"
    canvas, placement = letterbox(
        image, INPUT_SIZE, INPUT_SIZE, fill=PADDING_VALUE, where="top-left", how=how
    )
    (logits,) = session.run(["logits"], {"image": canvas[None].astype(np.float32)})
    rows, columns = (-(-side // STRIDE) for side in placement.inner)
    logits = logits[0, :rows, :columns, 1:]
    exponential = np.exp(logits - logits.max(axis=-1, keepdims=True))
    total = exponential.sum(axis=-1, keepdims=True)
    probability = exponential @ _surface_of_class() / total
    framed = exponential[..., np.array(_FRAMED) - 1].sum(-1) / total[..., 0]
    corners = placement.to_canvas(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])) / STRIDE
    to_grid = np.stack([corners[1] - corners[0], corners[2] - corners[0], corners[0]], axis=1)
    return probability, framed, to_grid


def label_surfaces(
    session: OnnxSession,
    image: UInt8Array,
    people: BoolArray,
) -> tuple[SurfaceLabels, BoolArray]:
    """Label each pixel with its most probable surface, and return the pixels (H, W) of paintings
    and mirrors, also on people.

    The network sees people in plain grey: it extends those that it recognises over what they sit
    on.

    Args:
        session: of ``deeplabv3_mnv2_ade20k``.
        image: (H, W, 3) uint8 RGB.
        people: (H, W), pixels of people; they are "person".
    """
    import cv2

    height, width = image.shape[:2]
    without_people = image.copy()
    without_people[people] = PADDING_VALUE
    probability, framed, to_grid = predict_surfaces(session, without_people)
    labels = np.zeros((height, width), np.uint8)
    best = np.full((height, width), _LEAST_PROBABILITY, np.float32)

    def resampled_to_photo(grid: FloatArray) -> FloatArray:
        whole: FloatArray = cv2.warpAffine(
            np.ascontiguousarray(grid, np.float32),
            to_grid,
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return whole

    for index in np.flatnonzero(probability.max(axis=(0, 1)) >= _LEAST_PROBABILITY):
        class_probability = resampled_to_photo(probability[..., index])
        better = class_probability >= best
        labels[better] = index
        best[better] = class_probability[better]
    labels[people] = SURFACE_NAMES.index("person")
    return SurfaceLabels(labels), resampled_to_photo(framed) >= _LEAST_PROBABILITY


@cache
def _surface_of_class() -> FloatArray:
    """Return (31, S), 1 where a class of the network belongs to a surface."""
    matrix = np.zeros((31, len(SURFACE_NAMES)), np.float32)
    for name, classes in ADE20K_CLASSES.items():
        matrix[np.array(classes) - 1, SURFACE_NAMES.index(name)] = 1
    return matrix
