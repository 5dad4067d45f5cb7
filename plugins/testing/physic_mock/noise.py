"""The errors of all mocks: how large they are, and how they are drawn.

Random numbers depend only on the world, the noise seed and the purpose, and their scale only on the
options: twice the noise gives twice the same error.
"""

from __future__ import annotations

import math
import zlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray
    from physic_mock.recognition import MockOptions
    from physic_testing.worlds import World

NORMAL = {
    "focal length of both depths": (math.log(1.2), 0.07),  # log of the focal length
    "metric scale": (0, 0.09),  # log of depth, beside the focal length's or the bodies' error
    "unit of both": (0, 0.3),  # log of the point map's unit, in both images
    "unit of the photo": (0, 0.15),  # the same, in the photo with people alone
    "depth of person": (0.1, 0.08),  # log of a person's depth; above 0 is too far
    "offset of inverse depth": (0.6, 0.4),  # share of the inverse depth of the farthest surfaces
    "up": (0, 1.5),  # in each of two directions, deg
}
"""Purpose of a normal error -> its mean and standard deviation at noise 1."""

SMOOTH = {
    "hole": (0.03, 6),  # where an inpainter made the picture up
    "bumps": (0.007, 16),
    "point map": (0.012, 2),  # of the whole map
    "point map of the": (0.014, 3),  # of each of the two images alone
}
"""Purpose of a smooth error of log depth -> its standard deviation at noise 1, and its number of
waves across the longer side.
"""

SHARES = {
    "flipped segments": 0.06,  # of limb segments, which point towards the camera, not away
    "flipped forearms": 0.15,  # the same of forearms
    "wrong visibility": 0.03,  # of joints
    "missed hands": 0.1,  # of the hands in sight
    "overconfident": 0.5,  # of hidden keypoints, which look sure
    "unsure": 0.15,  # of keypoints in sight, which do not
    "limbs of neighbours": 0.05,  # of the limbs of people whose boxes overlap
    "swapped sides": 0.02,  # of people's pairs of arms, and of legs
    "missed ends": 0.04,  # of hands and feet, which the masks lack
    "strays": 0.15,  # of people whose mask takes in a bit of what is beside them
    "missed floors": 0.22,  # of photos
    "spills": 1.5 / 8,  # of 8 bits each of other things in the floor's mask, and of lacking bits
}
"""What goes wrong -> how often at noise 1."""

POINT_SIGMA = 0.016  # of keypoints along x and along y, over the larger side of the person's box
HIDDEN_POINT_SIGMA = 0.065  # the same of hidden keypoints
POINT_FREEDOM = 1.5  # degrees of Student's t distribution of their errors, one scale for each limb
LIMB_SHARE = 0.5  # of the variance of keypoints or bones, common to an arm, a leg or the rest
HIDDEN_CONFIDENCE = 0.3  # mean of hidden keypoints, give or take half of it; others have about .9
LEAN_DEG = 10.0  # of bones about each axis across the line of sight
PLANE_DEG = 6.0  # of bones about the line of sight
TRUNK_FACTOR = 0.5  # on both, of trunk, neck and head
HIDDEN_FACTOR = 2.0  # on both, of bones whose end is hidden
ROOT_DEG = 6.0  # of the trunk between limbs that stay
ROOT_LEAN_FACTOR = 2.2  # on it, across the line of sight
POSE_SIGMA = 0.3  # of the logarithm of a person's factor on all of these rotations
FINGER_DEG = 10.0  # of finger joints about each axis
SHAPE_SIGMA = 0.4  # of each shape component; those that change the stature less
STATURE_SIGMA = 0.045  # of the logarithm of stature over the true one
DISTANCE_SHARE = 0.5  # of the variance of log distance, common to all people of a photo
LATERAL_M = 0.03  # across the line of sight
RELIEF_LOST = 0.3  # share of people's relief about their own median depth
SMEAR_PX = 2.0  # width of the blur of depth edges, of a photo 640 px wide
RAGGED_PX = 1.2  # how far the masks' borders stray, of a photo 640 px wide
LOG_ODDS = 3.0  # of what is true; with a noise of 1 they are calibrated, with an AUC of .96
LOG_ODDS_SIGMA = math.sqrt(2 * LOG_ODDS)
HEAD_DEG = (2.0, 8.0)  # standard deviation without noise; what a noise of 1 adds

_REFERENCE_WIDTH_PX = 640  # longer image side for which lengths in px are defined


class Noise:
    """Errors of one mock in one world.

    Attributes:
        world: the world.
        factor: factor on all errors.
    """

    def __init__(self, world: World, options: MockOptions) -> None:
        self.world = world
        self.factor = options.noise
        self._seed = options.noise_seed

    def rng(self, purpose: str, *, all_views: bool = False) -> np.random.Generator:
        """Return a random generator that depends only on the world, the noise seed and the purpose.

        Views of one moment have errors of their own, but for what every photo of a person shows
        alike (``all_views``).
        """
        name = self.world.name.partition("_view")[0] if all_views else self.world.name
        return np.random.default_rng([self._seed, zlib.crc32(f"{name} {purpose}".encode())])

    def normal(self, name: str, of: str = "") -> float:
        """Draw an error of NORMAL, of one of several things of this kind."""
        mean, sigma = NORMAL[name]
        return self.factor * (mean + sigma * self.rng(f"{name} {of}".rstrip()).normal())

    def smooth(
        self, name: str, shape: tuple[int, int], of: str = "", ramp: FloatArray | float = 1.0
    ) -> FloatArray:
        """Draw factors (H, W) of an error of SMOOTH, whose logarithm is multiplied by ``ramp``."""
        sigma, waves = SMOOTH[name]
        image = smooth_image(shape, waves, self.rng(f"{name} {of}".rstrip()))
        return np.exp(self.factor * sigma * ramp * image)

    def draw_is_below(self, share: str | float, draws: FloatArray) -> BoolArray:
        """Return which uniform draws (...) are below a share, or one of SHARES, times the noise."""
        least = SHARES[share] if isinstance(share, str) else share
        return draws < min(1.0, least * self.factor)

    def rough_border(self, mask: BoolArray, rng: np.random.Generator) -> BoolArray:
        """Return the mask (H, W) with its border shifted by about RAGGED_PX, in waves of about 12
        px.
        """
        import cv2

        stray = smooth_image(mask.shape, _REFERENCE_WIDTH_PX / 12, rng)
        if self.factor == 0:
            return mask.copy()
        inside = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
        outside = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
        amount = self.factor * scale_to_image(RAGGED_PX, mask.shape)
        moved: BoolArray = inside - outside + amount * stray > 0
        return moved


def scale_to_image(stated_px: float, shape: tuple[int, int]) -> float:
    """Scale a length from an image 640 px wide to an image of shape (H, W), px."""
    return stated_px * max(shape) / _REFERENCE_WIDTH_PX


def smooth_image(shape: tuple[int, int], waves: float, rng: np.random.Generator) -> FloatArray:
    """Return a random smooth image (H, W) of unit variance, the sum of 12 plane waves, with about
    ``waves`` waves on the longer side.
    """
    directions = rng.normal(size=(12, 2))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lengths = 2 * np.pi / (1 / waves * rng.uniform(0.7, 1.6, 12))
    phases = rng.uniform(0, 2 * np.pi, 12)
    v, u = np.mgrid[: shape[0], : shape[1]] / max(shape)
    points = np.stack([u, v], axis=-1)
    total = np.zeros(shape)
    for direction, length, phase in zip(directions, lengths, phases, strict=True):
        total += np.cos(points @ direction * length + phase)
    image: FloatArray = total * np.sqrt(2 / 12)
    return image
