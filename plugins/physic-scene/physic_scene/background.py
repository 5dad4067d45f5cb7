"""Background of several photos: matched pixels, and photos that are the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.stats import binom

from physic_core.types.bounds import NotNegative, PointCount, Positive, PositiveCount, Share
from physic_scene.bundle import PixelMatches

if TYPE_CHECKING:
    from physic_core.types import FloatArray, MomentView, UInt8Array

_MINIMAL, _SOLUTIONS = 5, 10  # matches that give a motion between two cameras, and how many they give at most


@dataclass(frozen=True)
class BackgroundSettings:
    """Settings of the matcher (SIFT, Lowe's ratio, an essential matrix by RANSAC).

    Attributes:
        longest_px: photos are reduced to this longer side.
        features: most of a photo.
        ratio: largest distance of the best match, as a share of that of the second best.
        inlier_px: largest distance from the epipolar line, px of the reduced photo.
        certain: least logarithm of the ratio of likelihoods "these photos show one background" over "the matches agree
            by chance" of pixels that enter the adjustment of cameras. 10 are odds of 20,000 to 1.
        trials: samples of five matches that a motion between two cameras is sought with. 1000 find it, with a chance of
            .9, where three of ten matches are right, in 0.1 s.
    """

    longest_px: PointCount = 1000
    features: PointCount = 3000
    ratio: Share = 0.75
    inlier_px: Positive = 1.5
    certain: NotNegative = 10.0
    trials: PositiveCount = 1000


@dataclass(frozen=True)
class Background:
    """Features of a photo without its people.

    Attributes:
        points: (n, 2) px of the photo.
        descriptors: (n, 128).
        thumbnail: (32, 32) grey levels of the photo, mean 0.
    """

    points: FloatArray
    descriptors: FloatArray
    thumbnail: FloatArray


def sees(view: MomentView, settings: BackgroundSettings) -> Background:
    """Return the features of a photo outside its people."""
    image = np.asarray(view.image)
    height, width = image.shape[:2]
    free = ~view.people.masks.any(axis=0)
    scale = min(1.0, settings.longest_px / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    grey = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
    mask = cv2.erode(
        cv2.resize(free.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST), np.ones((5, 5), np.uint8)
    )
    points, descriptors = _features(grey, mask, settings)
    factor = np.array([width, height]) / size
    small = cv2.resize(grey, (32, 32), interpolation=cv2.INTER_AREA).astype(np.float64)
    return Background((points + 0.5) * factor - 0.5, descriptors, small - small.mean())


def same_photo(one: Background, two: Background) -> bool:
    """Return whether two photos are the same picture, perhaps of other size, compression or brightness."""
    a, b = one.thumbnail, two.thumbnail
    gain = (a * b).sum() / max((b * b).sum(), 1e-9)
    return bool(np.abs(a - gain * b).max() < 6 and 0.5 < gain < 2)


def same_background(
    one: Background,
    two: Background,
    cameras: tuple[FloatArray, FloatArray],
    views: tuple[int, int],
    settings: BackgroundSettings,
) -> PixelMatches | None:
    """Return the pixels of two photos that agree with one motion between their cameras; None if that is not certain.

    The evidence is the negative logarithm of the number of false alarms: the number of motions that were tried, times
    the binomial probability that as many of the matches would agree if each did with the share of pixels that do not
    match.

    Args:
        one: background of the first photo.
        two: background of the second photo.
        cameras: (3, 3) px of both.
        views: numbers of both photos.
        settings: of the matcher.
    """
    matches = np.hstack(_ratio_matches(one, two, settings))
    # Features of several directions at one pixel are one piece of evidence.
    _, single = np.unique(matches.round(), axis=0, return_index=True)
    if len(single) <= _MINIMAL:
        return None
    pixels = matches[single, :2], matches[single, 2:]
    one_rays, two_rays = ((points - K[:2, 2]) / np.diag(K)[:2] for points, K in zip(pixels, cameras, strict=True))
    longest = 2 * max(K[:2, 2].max() for K in cameras)
    limit = settings.inlier_px * max(1.0, longest / settings.longest_px) / np.mean([K[0, 0] for K in cameras])
    cv2.setRNGSeed(0)
    essential, agrees = cv2.findEssentialMat(one_rays, two_rays, np.eye(3), cv2.RANSAC, 0.999, limit, settings.trials)
    if essential is None or essential.shape != (3, 3):
        return None
    count, _, _, agrees = cv2.recoverPose(essential, one_rays, two_rays, np.eye(3), mask=agrees)
    first, second = (np.column_stack([ray, np.ones(len(ray))]) for ray in (one_rays, two_rays))
    line_two, line_one = first @ essential.T, second @ essential
    slope = np.hypot(*line_two[:, :2].T)[:, None] ** 2 + np.hypot(*line_one[:, :2].T) ** 2
    near = np.abs(line_two @ second.T) < limit * np.sqrt(slope)
    chance = (1 + near.sum() - np.trace(near)) / (1 + near.size - len(near))
    llr = -np.log(_SOLUTIONS * settings.trials) - binom.logsf(count - _MINIMAL - 1, len(single) - _MINIMAL, chance)
    if llr < settings.certain:
        return None
    kept = agrees.ravel() > 0
    return PixelMatches(views, pixels[0][kept], pixels[1][kept])


def _features(grey: UInt8Array, mask: UInt8Array, settings: BackgroundSettings) -> tuple[FloatArray, FloatArray]:
    found, descriptors = cv2.SIFT.create(nfeatures=settings.features).detectAndCompute(grey, mask)
    if descriptors is None:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    # Square roots of normalised histograms: Euclidean distance is then that of Hellinger (RootSIFT).
    descriptors = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9)).astype(np.float32)
    return np.array([point.pt for point in found], np.float64), descriptors


def _ratio_matches(one: Background, two: Background, settings: BackgroundSettings) -> tuple[FloatArray, FloatArray]:
    """Return the pixels (n, 2) of both photos whose features match by Lowe's ratio."""
    if not len(one.points) or len(two.points) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    pairs = cv2.BFMatcher().knnMatch(one.descriptors, two.descriptors, k=2)
    good = [best for best, second in pairs if best.distance < settings.ratio * second.distance]
    good = list({match.trainIdx: match for match in sorted(good, key=lambda m: -m.distance)}.values())
    return one.points[[m.queryIdx for m in good]], two.points[[m.trainIdx for m in good]]
