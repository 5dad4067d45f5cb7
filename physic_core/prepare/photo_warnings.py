"""Warn of photos that mislead all networks: panoramas, and dark and blurred photos."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import UInt8Array

_WIDEST = 2.4  # ratio of the sides; a film has 2.39, and of 529 photos none more than 1.92
_FULL_CIRCLE = 2.0  # the same of a panorama with both poles
_SAME_RATIO = 0.01
_WIDTH = 512  # px at which the edges of a panorama are compared
# Of 25 panoramas at 12 turns each, .97 pass; of 1,497 crops of photos none.
_SEAM_STEPS = 1.6  # largest step from one edge to the other, in steps beside the edges
_SEAM_SHARE = 0.45  # the same, in deviations of the colors along the edges
_LEAST_DEVIATION = 8.0  # of 255; a plain ground continues everywhere
_PERCENTILE = 95  # of gray levels; of 529 photos, some by night, at least 81
_DARK = 20  # of 255; of 8 people in darkened photos, none is lost at 17 to 21, half at 9 to 13
_SHARP_SIDE = 512  # px, at which edges are measured
_SQUARE_PX = 13  # in which the height of an edge is
_LEAST_EDGE = 30.0  # of 255
# At a blur of .6 % of the long side, poses of 6 people move by 2 to 10 cm, and edges are 7 px wide;
# at 1.2 %, by 4 to 22 cm, and 10 px. Of 260 photos at most 3.1 px.
_WIDEST_EDGE_PX = 8.0


def photo_warnings(image: UInt8Array) -> tuple[str, ...]:
    """Return why networks may misread an image (H, W, 3), and what to do."""
    warnings = _panorama_warning(image), _dark_warning(image), _blur_warning(image)
    return tuple(filter(None, warnings))


def _panorama_warning(image: UInt8Array) -> str:
    height, width = image.shape[:2]
    ratio = width / height
    if ratio > _WIDEST:
        return (
            f"a panorama? The photo is {ratio:.1f} times as wide as high (limit {_WIDEST:g}). If "
            "several shots were joined, all distances and sizes are wrong: run one of the shots"
        )
    if abs(ratio / _FULL_CIRCLE - 1) > _SAME_RATIO or not _joins_at_edges(image):
        return ""
    return (
        "a panorama? The photo is twice as wide as high, and its left edge continues its right "
        "edge. All distances and sizes are then wrong: save a perspective view of the people in a "
        "panorama viewer, and run that"
    )


def _dark_warning(image: UInt8Array) -> str:
    import cv2

    level = np.percentile(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), _PERCENTILE)
    if level >= _DARK:
        return ""
    return (
        f"the photo is too dark: {_PERCENTILE} % of its pixels are below {level:.0f} of 255 "
        f"(limit {_DARK}). PhySIC may miss people, and poses are less certain: brighten the "
        "photo, or take one with more light"
    )


def _blur_warning(image: UInt8Array) -> str:
    import cv2

    scale = min(1.0, _SHARP_SIDE / max(image.shape[:2]))
    size = [max(1, round(side * scale)) for side in image.shape[1::-1]]
    gray = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    square = np.ones((_SQUARE_PX, _SQUARE_PX), np.uint8)
    heights = cv2.morphologyEx(gray, cv2.MORPH_GRADIENT, square)[:-1, :-1].astype(float)
    across, down = (np.abs(np.diff(gray.astype(float), axis=axis)) for axis in (1, 0))
    steps = np.maximum(across[:-1], down[:, :-1])
    highest = heights >= max(np.percentile(heights, 95), _LEAST_EDGE)
    if not highest.any():
        return ""
    width = 1 / max(float(np.percentile(steps[highest] / heights[highest], 98)), 1e-3)
    if width <= _WIDEST_EDGE_PX:
        return ""
    return (
        f"the photo is blurred: at a long side of {max(size)} px, its sharpest edges are "
        f"{width:.0f} px wide (limit {_WIDEST_EDGE_PX:.0f} px). Poses are less certain: use a "
        "sharper photo"
    )


def _joins_at_edges(image: UInt8Array) -> bool:
    """Return whether the left edge of an image (H, W, 3) continues its right edge."""
    import cv2

    height, width = image.shape[:2]
    size = _WIDTH, max(1, round(_WIDTH * height / width))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(float)
    edges = small[:, [-2, -1, 0, 1]]
    before, seam, after = np.abs(np.diff(edges, axis=1)).max(-1).mean(0)
    ends = edges[:, 1:3].mean(1)
    deviation = np.abs(ends - np.median(ends, axis=0)).max(-1).mean()
    most = min(_SEAM_STEPS * ((before + after) / 2 + 1), _SEAM_SHARE * deviation)
    return bool(deviation >= _LEAST_DEVIATION and seam <= most)
