"""Scale of a relative scene by each person: by the soles on its floor, and by the depth of the torso.

Camera frame of the bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from physic_core.body.joints import JOINT_INDEX
from physic_core.types.skeletons import SIDES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.body.model import BodyModel
    from physic_core.types import Plane, Pointmap

    FloatArray = NDArray[np.floating[Any]]
    BoolArray = NDArray[np.bool_]

_RAYS = 4000  # largest number of sampled pixels of each person
_MIN_PIXELS = 30
_MIN_HITS = 20
_ERODED_SHARE = 0.004  # of the long side: the depth of the background bleeds into the edge of a mask


def scales_by_soles(vertices: FloatArray, model: BodyModel, observed: BoolArray, floor: Plane) -> FloatArray:
    """Return the scale (N, 2), metres per unit, that puts the left and the right sole of each person on the floor.

    With the plane n . X + h = 0 in units of the scene, a point X in metres lies on it for the scale -n . X / h. The
    normal does not depend on the scale, and the lowest vertex of a sole is the one with the largest.

    Args:
        vertices: (N, V, 3) metres.
        model: the body.
        observed: (N, 55) bool, visible joints.
        floor: plane in units of the scene.

    Returns:
        (N, 2) NaN for feet that are not visible.
    """
    scale = np.full((len(vertices), 2), np.nan)
    if floor.offset <= 0:
        return scale
    normal = np.asarray(floor.normal, np.float64)
    for k, side in enumerate(SIDES):
        ids = model.contact_sets[f"{side}_sole"].cpu().numpy()
        lowest = (-vertices[:, ids] @ normal).max(1) / floor.offset
        seen = observed[:, JOINT_INDEX[f"{side}_ankle"]] & observed[:, JOINT_INDEX[f"{side}_foot"]]
        scale[:, k] = np.where(seen & (lowest > 0), lowest, np.nan)
    return scale


def scales_by_torsos(
    vertices: FloatArray, model: BodyModel, masks: BoolArray, photo: Pointmap, camera: FloatArray
) -> FloatArray:
    """Return the scale (N,), metres per unit, that makes the relative depth of each torso equal to its depth in metres.

    Args:
        vertices: (N, V, 3) metres.
        model: the body.
        masks: (N, H, W) bool, visible pixels of each person.
        photo: point map of the photo with its people, in units of the scene.
        camera: (3, 3) px.

    Returns:
        (N,) NaN for people whose torso is not visible, or mostly at infinity in the point map.
    """
    faces = model.faces.cpu().numpy()
    torso = model.part_of_vertex.cpu().numpy()[faces[:, 0]] == model.part_names.index("torso")
    return np.array(
        [_scale_by_torso(body, faces, torso, mask, photo, camera) for body, mask in zip(vertices, masks, strict=True)]
    )


def _scale_by_torso(
    body: FloatArray,
    faces: NDArray[np.int64],
    torso: BoolArray,
    mask: BoolArray,
    photo: Pointmap,
    camera: FloatArray,
) -> float:
    """Return the median ratio of body depth to map depth over the pixels of a mask whose ray hits the torso first."""
    from physic_core.geometry.rays import RayCaster

    rows, columns = np.nonzero(_erode(mask) & photo.valid)
    if len(rows) < _MIN_PIXELS or not np.isfinite(body).all():
        return float("nan")
    chosen = np.linspace(0, len(rows) - 1, min(_RAYS, len(rows))).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    directions = np.stack(
        [(columns - camera[0, 2]) / camera[0, 0], (rows - camera[1, 2]) / camera[1, 1], np.ones(len(rows))], -1
    )
    hits = RayCaster(body, faces).first(np.zeros(3), directions)
    on_torso = (hits.face >= 0) & torso[hits.face]
    if on_torso.sum() < _MIN_HITS:
        return float("nan")
    # The ray's direction has z = 1, so the distance along it is the depth.
    ratio = hits.distance[on_torso] / photo.points[rows[on_torso], columns[on_torso], 2]
    scale = float(np.median(ratio[np.isfinite(ratio)]))
    return scale if scale > 0 else float("nan")


def _erode(mask: BoolArray) -> BoolArray:
    import cv2

    reach = max(1, round(_ERODED_SHARE * max(mask.shape)))
    disc = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), disc) > 0)
