"""Background of several photos: matched pixels, photos that are the same, and photos that are mirrored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from physic_scene.bundle import PixelMatches

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Reconstruction, UInt8Array

__all__ = ["Background", "BackgroundSettings", "is_mirrored", "match_background", "same_photo", "sees"]


@dataclass(frozen=True)
class BackgroundSettings:
    """Settings of the matcher (SIFT, Lowe's ratio, a fundamental matrix by RANSAC).

    Attributes:
        longest_px: photos are reduced to this longer side.
        features: most of a photo.
        ratio: largest distance of the best match, as a share of that of the second best.
        inlier_px: largest distance from the epipolar line, px of the reduced photo.
        fewest: least number of inliers; random photos have fewer.
        mirrored: a photo is mirrored if its mirror image has this many times the inliers of the photo itself.
    """

    longest_px: int = 1000
    features: int = 3000
    ratio: float = 0.75
    inlier_px: float = 1.5
    fewest: int = 20
    mirrored: float = 2.0


@dataclass(frozen=True)
class Background:
    """Features of a photo without its people.

    Attributes:
        points: (n, 2) px of the photo.
        descriptors: (n, 128).
        mirrored: (m, 128), descriptors of the mirror image.
        mirrored_points: (m, 2) px of the mirror image.
        thumbnail: (32, 32) grey levels of the photo, mean 0.
    """

    points: FloatArray
    descriptors: FloatArray
    mirrored_points: FloatArray
    mirrored: FloatArray
    thumbnail: FloatArray


def sees(result: Reconstruction, settings: BackgroundSettings) -> Background:
    """Return the features of a photo outside its people."""
    image = np.asarray(result.image)
    height, width = image.shape[:2]
    free = np.ones((height, width), bool)
    for person in result.people:
        free &= ~person.mask
    scale = min(1.0, settings.longest_px / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
    mask = cv2.erode(
        cv2.resize(free.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST), np.ones((5, 5), np.uint8)
    )
    points, descriptors = _features(grey, mask, settings)
    mirror_points, mirror = _features(
        np.ascontiguousarray(grey[:, ::-1]), np.ascontiguousarray(mask[:, ::-1]), settings
    )
    factor = np.array([width, height]) / size
    small = cv2.resize(grey, (32, 32), interpolation=cv2.INTER_AREA).astype(np.float64)
    return Background(
        (points + 0.5) * factor - 0.5, descriptors, (mirror_points + 0.5) * factor - 0.5, mirror, small - small.mean()
    )


def same_photo(one: Background, two: Background) -> bool:
    """Return whether two photos are the same picture, perhaps of other size, compression or brightness."""
    a, b = one.thumbnail, two.thumbnail
    gain = (a * b).sum() / max((b * b).sum(), 1e-9)
    return bool(np.abs(a - gain * b).max() < 6 and 0.5 < gain < 2)


def match_background(
    one: Background, two: Background, views: tuple[int, int], settings: BackgroundSettings
) -> PixelMatches | None:
    """Return the pixels of two photos that show the same points of the background; None with too few."""
    return _matches(one.points, one.descriptors, two.points, two.descriptors, views, settings)


def is_mirrored(one: Background, two: Background, upright: PixelMatches | None, settings: BackgroundSettings) -> bool:
    """Return whether the background of the second photo is that of the first in a mirror."""
    turned = _matches(one.points, one.descriptors, two.mirrored_points, two.mirrored, (0, 1), settings)
    if turned is None:
        return False
    return len(turned.first) >= settings.mirrored * (0 if upright is None else len(upright.first))


def _features(grey: UInt8Array, mask: UInt8Array, settings: BackgroundSettings) -> tuple[FloatArray, FloatArray]:
    found, descriptors = cv2.SIFT.create(nfeatures=settings.features).detectAndCompute(grey, mask)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    # Square roots of normalised histograms: Euclidean distance is then that of Hellinger (RootSIFT).
    descriptors = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9)).astype(np.float32)
    return np.array([point.pt for point in found], np.float64), descriptors


def _matches(
    points: FloatArray,
    descriptors: FloatArray,
    other_points: FloatArray,
    others: FloatArray,
    views: tuple[int, int],
    settings: BackgroundSettings,
) -> PixelMatches | None:
    if min(len(points), len(other_points)) < settings.fewest:
        return None
    pairs = cv2.BFMatcher().knnMatch(descriptors, others, k=2)
    good = [best for best, second in pairs if best.distance < settings.ratio * second.distance]
    good = list({match.trainIdx: match for match in sorted(good, key=lambda m: -m.distance)}.values())
    if len(good) < settings.fewest:
        return None
    first, second = points[[m.queryIdx for m in good]], other_points[[m.trainIdx for m in good]]
    # OpenCV's MAGSAC fails an assertion for some degenerate pixels, such as those on one line.
    cv2.setRNGSeed(0)
    _, inlier = cv2.findFundamentalMat(first, second, cv2.FM_RANSAC, settings.inlier_px, 0.999, 5000)
    kept: BoolArray = np.zeros(len(first), bool) if inlier is None else inlier.ravel() > 0
    return PixelMatches(views, first[kept], second[kept]) if kept.sum() >= settings.fewest else None
