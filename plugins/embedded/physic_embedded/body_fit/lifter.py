"""Lift the limbs of fitted bodies: a small network that knows how people move tells their joints
from the keypoints and the fitted joints.

Joints are those of :data:`LIMBS`. The network sees them in the axes of a camera that looks at the
person, about the middle of the hips, in units of the person's limbs.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from physic_core.files import read_arrays
from physic_embedded.body_fit.limb_keypoints import HIP_WEIGHT, LIMBS

if TYPE_CHECKING:
    from physic_core.types import FloatArray


NUMBERS = Path(__file__).with_suffix(".npz")
"""Fitted weights and biases of the network, float16: ``weight0`` (width, inputs), ``bias0`` and so
on.
"""

HIPS = [LIMBS.index("left_hip"), LIMBS.index("right_hip")]
BONES = tuple((row, row + 2) for row in (0, 1, 2, 3, 6, 7, 8, 9))
"""Rows of the upper and of the lower end of each bone of :data:`LIMBS`."""
LIMB_SUM_M = 2.6
"""Sum of the lengths of the eight bones that is the unit of length of the network."""

# Extent in depth, in lengths of the forearm, below which its sign is a guess.
# Fitted to 122 forearms of mpi_inf_3dhp, panoptic, roundtable and parkour; .3 to .45 without one of
# these sets.
_GUESSED_TILT = 0.3
_FOREARMS = BONES[2:4]

_SWAPPED = [row ^ 1 for row in range(len(LIMBS))]  # left and right
_MIRROR = np.array([-1.0, 1.0, 1.0])
_POINT_GAIN = 4.0  # brings offsets of keypoints to the size of the other inputs


class LimbView(NamedTuple):
    """What the network sees of N people; x right, y down, z away from a camera that looks at the
    person, metres.

    Attributes:
        joints: (N, 12, 3) of fitted bodies, relative to the middle of the hips.
        points: (N, 12, 2) keypoints on the plane through the middle of the hips.
        confidence: (N, 12) of the keypoints, in [0, 1].
        up: (N, 3) unit vectors, 0 where unknown.
        depth: (N,) from the camera to the middle of the hips.
    """

    joints: FloatArray
    points: FloatArray
    confidence: FloatArray
    up: FloatArray
    depth: FloatArray


def predict_joints(view: LimbView) -> FloatArray:
    """Return the joints (N, 12, 3) that the network tells, relative to the middle of the hips.

    A mirror image of the view gives the mirror image of the joints. Forearms that tilt little in
    depth are told flatter than the network has them, as it guesses to which side they tilt.
    """
    joints, points, confidence, up, depth = view
    mirrored = LimbView(
        (joints * _MIRROR)[:, _SWAPPED],
        (points * _MIRROR[:2])[:, _SWAPPED],
        confidence[:, _SWAPPED],
        up * _MIRROR,
        depth,
    )
    lifted = (
        joints
        + (_predicted_offsets(view) + (_predicted_offsets(mirrored) * _MIRROR)[:, _SWAPPED]) / 2
    )
    for elbow, wrist in _FOREARMS:
        forearm = lifted[:, wrist] - lifted[:, elbow]
        tilt = forearm[:, 2] ** 2 / (forearm**2).sum(1)
        lifted[:, wrist, 2] = lifted[:, elbow, 2] + forearm[:, 2] * tilt / (tilt + _GUESSED_TILT**2)
    return np.asarray(lifted - lifted[:, HIPS].mean(1, keepdims=True))


def network_inputs(view: LimbView) -> FloatArray:
    """Return the inputs (N, 76) of the network for a view with lengths in units of
    :func:`length_unit`.

    The fit has put the body where it projects onto the keypoints; what is left of a common offset
    is no error of a limb.
    """
    joints, points, confidence, up, depth = view
    count = len(joints)
    projected = joints[..., :2] * (depth[:, None] / (joints[..., 2] + depth[:, None]))[..., None]
    weight = np.array(confidence, np.float64)[..., None]
    weight[:, HIPS] *= HIP_WEIGHT
    shift = (weight * (points - projected)).sum(1, keepdims=True) / weight.sum(1, keepdims=True)
    offsets = _POINT_GAIN * (points - shift - joints[..., :2])
    parts = [joints, offsets, confidence, up, 1 / depth]
    return np.concatenate([part.reshape(count, -1) for part in parts], 1)


def length_unit(joints: FloatArray) -> FloatArray:
    """Return the unit of length (N, 1, 1) of joints (N, 12, 3), metres."""
    upper, lower = np.array(BONES).T
    lengths = np.linalg.norm(joints[:, lower] - joints[:, upper], axis=-1)
    return np.asarray(lengths.sum(1)[:, None, None] / LIMB_SUM_M)


def _predicted_offsets(view: LimbView) -> FloatArray:
    """Return how far (N, 12, 3) the network moves the joints, metres."""
    unit = length_unit(view.joints)
    x = network_inputs(
        view._replace(
            joints=view.joints / unit, points=view.points / unit, depth=view.depth / unit[:, 0, 0]
        )
    )
    layers = _layers()
    hidden = np.maximum(_linear_layer(layers[0], x), 0)
    for first, second in zip(layers[1:-1:2], layers[2:-1:2], strict=True):
        hidden = hidden + np.maximum(
            _linear_layer(second, np.maximum(_linear_layer(first, hidden), 0)), 0
        )
    return _linear_layer(layers[-1], hidden).reshape(view.joints.shape) * unit


def _linear_layer(layer: tuple[FloatArray, FloatArray], x: FloatArray) -> FloatArray:
    """Return x (N, C) after weights (D, C) and a bias (D,)."""
    weight, bias = layer
    # Not by BLAS, whose threads would wait for each other.
    return np.asarray(np.einsum("nc,dc->nd", x, weight) + bias)


@cache
def _layers() -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return weights (D, C) and biases (D,) of the layers, float64."""
    with NUMBERS.open("rb") as stream:
        arrays = read_arrays(stream)
    return tuple(
        (arrays[f"weight{k}"].astype(np.float64), arrays[f"bias{k}"].astype(np.float64))
        for k in range(len(arrays) // 2)
    )
