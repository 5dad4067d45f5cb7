"""Compare the silhouettes of the final bodies with people's masks and with the depth of the photo.

Camera frame, metres. Silhouettes are drawn at a reduced size, so that a body takes a fraction of a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
import torch.nn.functional as F

from physic_core.engine.placement.background import dilate_square
from physic_core.geometry.camera import project
from physic_core.geometry.raster import rasterize

if TYPE_CHECKING:
    from torch import Tensor

_LONG_SIDE_PX = 400
_CLOTHES = 0.08  # of the square root of the mask's area: clothes and hair reach beyond the body
_RIM = 0.03  # of the same: the body may leave the mask by this much
_IN_FRONT_M = 0.05  # a scene point nearer than the body by more hides it
_LOW_SHARE = 0.15  # of the silhouette's height: feet of a standing person, seat or knees of another
_MIN_PIXELS = 10  # pixels with a depth, for a median


@dataclass(frozen=True)
class PhotoEvidence:
    """References for the comparison of the final bodies.

    Attributes:
        masks: (N, H, W) bool, visible pixels of N people.
        scene_depth: (H, W) metres along z of the scene without people, NaN where unknown; or None.
        photo_depth: (H, W) metres along z of the photo with its people, NaN where unknown; or None.
        K: (3, 3) px.
    """

    masks: Tensor
    scene_depth: Tensor | None
    photo_depth: Tensor | None
    K: Tensor


def compare_silhouettes(vertices: Tensor, faces: Tensor, photo: PhotoEvidence) -> list[dict[str, float | None]]:
    """Measure how the silhouettes of N bodies agree with their masks, and the depth of their lower ends.

    Args:
        vertices: (N, V, 3) metres.
        faces: (F, 3) int64.
        photo: of the same N people.

    Returns:
        Per person "mask_covered_share": share of the mask within the body's silhouette, dilated for clothes;
        "body_in_mask_share": share of the silhouette within the mask, without pixels occluded by other people or
        nearer objects, or outside the photo; "low_depth_ratio": median ratio of the photo's depth to the
        body's over the lowest visible part of the silhouette. None where nothing can be measured.
    """
    small = _reduced(photo)
    depths = _body_depths(vertices.to("cpu", torch.float32), faces.cpu(), small)
    return [_compare(i, depth, small) for i, depth in enumerate(depths)]


def _reduced(photo: PhotoEvidence) -> PhotoEvidence:
    """Return the same at a reduced size, on the CPU."""
    height, width = photo.masks.shape[-2:]
    scale = min(1.0, _LONG_SIDE_PX / max(height, width))
    size = (max(1, round(height * scale)), max(1, round(width * scale)))
    masks = F.interpolate(photo.masks[:, None].float().cpu(), size, mode="area")[:, 0] > 0
    K = photo.K.to("cpu", torch.float32).clone()
    for row, factor in enumerate((size[1] / width, size[0] / height)):
        K[row] *= factor
        K[row, 2] += (factor - 1) / 2
    return PhotoEvidence(masks, _nearest(photo.scene_depth, size), _nearest(photo.photo_depth, size), K)


def _nearest(depth: Tensor | None, size: tuple[int, int]) -> Tensor | None:
    return None if depth is None else F.interpolate(depth[None, None].float().cpu(), size, mode="nearest")[0, 0]


def _body_depths(vertices: Tensor, faces: Tensor, photo: PhotoEvidence) -> list[Tensor]:
    """Return the depth of each body at each pixel, inf beside it: N times (H, W) metres."""
    height, width = photo.masks.shape[-2:]
    depths = []
    for body in vertices:
        face = rasterize(project(body, photo.K)[None], body[None, :, 2], faces, height, width)[0]
        z = body[faces][..., 2].mean(1)
        depths.append(torch.where(face >= 0, z[face.clamp(min=0)], torch.inf))
    return depths


def _compare(i: int, depth: Tensor, photo: PhotoEvidence) -> dict[str, float | None]:
    body, mask = torch.isfinite(depth), photo.masks[i]
    others = photo.masks.any(0) & ~mask
    size = math.sqrt(float(mask.sum()))
    seen = body & ~others
    if photo.scene_depth is not None:
        seen = seen & ~(photo.scene_depth < depth - _IN_FRONT_M)
    return {
        "mask_covered_share": _share(mask & dilate_square(body, max(1, round(_CLOTHES * size))), mask),
        "body_in_mask_share": _share(seen & dilate_square(mask, max(1, round(_RIM * size))), seen & mask.any()),
        "low_depth_ratio": None if photo.photo_depth is None else _low_depth_ratio(depth, mask, photo.photo_depth),
    }


def _low_depth_ratio(depth: Tensor, mask: Tensor, photo_depth: Tensor) -> float | None:
    body = torch.isfinite(depth)
    rows = body.any(1).nonzero()[:, 0]
    if not len(rows):
        return None
    low = torch.zeros_like(body)
    low[int(rows[-1] - _LOW_SHARE * (rows[-1] - rows[0])) :] = True
    ratio = (photo_depth / depth)[body & mask & low]
    ratio = ratio[torch.isfinite(ratio) & (ratio > 0)]
    return float(ratio.median()) if len(ratio) >= _MIN_PIXELS else None


def _share(part: Tensor, surface: Tensor) -> float | None:
    total = float(surface.sum())
    return float(part.sum()) / total if total > 0 else None
