"""Meshes that viser shows in their own colours, without light."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from physic_core.visual.glb_builder import ARRAY, INDICES, GlbBuilder
from physic_core.visual.palette import linear_from_srgb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# The tone curve of three.js (ACESFilmicToneMapping), which viser's page applies to all meshes.
_EXPOSURE = 1 / 0.6
_TO_CURVE = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_FROM_CURVE = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
_NUMERATOR = (1.0, 0.0245786, -0.000090537)
_DENOMINATOR = (0.983729, 0.4329510, 0.238081)


def unlit_glb(vertices: Array, faces: NDArray[np.integer], colors: NDArray[np.uint8]) -> bytes:
    """Return a GLB file of a mesh that viser's page shows in its colours.

    Even without light, the page's tone curve shows white as (225, 225, 225). The colours in the file are those that the
    curve turns into the wanted ones.

    Args:
        vertices: (V, 3) metres.
        faces: (F, 3), seen from both sides.
        colors: (V, 3) sRGB.
    """
    glb = GlbBuilder(generator="PhySIC")
    attributes = {
        "POSITION": glb.accessor(vertices.astype(np.float32), ARRAY, bounds=True),
        "COLOR_0": glb.accessor(_before_tone_curve(linear_from_srgb(colors)).astype(np.float32), ARRAY),
    }
    indices = glb.accessor(faces.reshape(-1).astype(np.uint32), INDICES)
    glb.add("materials", {"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}})
    glb.tree["extensionsUsed"] = ["KHR_materials_unlit"]
    mesh = glb.add("meshes", {"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]})
    glb.add("scenes", {"nodes": [glb.add("nodes", {"mesh": mesh})]})
    return glb.content()


def _before_tone_curve(shown: Array) -> Array:
    """Return the linear colours that the tone curve turns into linear colours (N, 3) in 0-1."""
    y = np.clip(shown @ np.linalg.inv(_FROM_CURVE).T, 0.0, 1.0)
    a, b, c = (n - d * y for n, d in zip(_NUMERATOR, _DENOMINATOR, strict=True))
    root = (-b + np.sqrt(np.maximum(b**2 - 4 * a * c, 0.0))) / (2 * a)
    return np.asarray(np.maximum(root @ np.linalg.inv(_TO_CURVE).T / _EXPOSURE, 0.0))
