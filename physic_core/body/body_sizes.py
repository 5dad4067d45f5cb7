"""Mass and girths that follow from the shape of a body in its T-pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from physic_core.body.joints import JOINT_INDEX

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from torch import Tensor

    from physic_core.body.model import BodyModel

DENSITY_KG_M3 = 1010.0
"""Density of a human body, whose volume has the lungs half filled."""

_STEP_M = 0.02
_BELOW = 0.25  # of the thigh, where the buttocks end


def body_sizes(model: BodyModel, betas: Tensor) -> dict[str, float]:
    """Return mass_kg, and chest_girth_m, waist_girth_m and hip_girth_m of a tape measure.

    The chest is measured halfway between the joint spine3 and the shoulders. The waist is the least
    girth from spine1 to spine3, the hips are the largest one from a quarter of the thigh below the
    hip joints to spine1.

    Args:
        model: of the shape.
        betas: (1, K), finite.
    """
    rotations, _, transl = model.zero_pose()
    posed = model(rotations, betas, transl)
    vertices = posed.vertices[0].double().cpu().numpy()
    faces = model.faces.cpu().numpy()
    heights = posed.joints[0, :, 1].tolist()
    hip, knee, low, high, shoulder = (
        heights[JOINT_INDEX[name]]
        for name in ("left_hip", "left_knee", "spine1", "spine3", "left_shoulder")
    )
    names = ("torso", "left_upper_leg", "right_upper_leg")
    trunk = np.isin(model.part_of_vertex.cpu(), [model.part_names.index(name) for name in names])
    band = vertices[faces[trunk[faces].all(1)]]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    buttocks = np.arange(hip - _BELOW * (hip - knee), low, _STEP_M)
    return {
        "mass_kg": DENSITY_KG_M3 * float((a * np.cross(b, c)).sum() / 6),
        "chest_girth_m": _girth(band, (high + shoulder) / 2),
        "waist_girth_m": min(_girth(band, y) for y in np.arange(low, high, _STEP_M)),
        "hip_girth_m": max(_girth(band, y) for y in buttocks),
    }


def _girth(triangles: NDArray[np.float64], height: float) -> float:
    """Return the length of a band around triangles (F, 3, 3) at a height, metres."""
    first = triangles.reshape(-1, 3)
    second = np.roll(triangles, -1, 1).reshape(-1, 3)
    crosses = (first[:, 1] < height) != (second[:, 1] < height)
    first, second = first[crosses], second[crosses]
    share = (height - first[:, 1]) / (second[:, 1] - first[:, 1])
    cut = first + share[:, None] * (second - first)
    return float(ConvexHull(cut[:, ::2]).area)
