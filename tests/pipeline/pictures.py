"""Pictures for tests of what is round a picture."""

from __future__ import annotations

import io

import cv2
import numpy as np
from PIL import Image


def textured(height, width, seed=0):
    """A picture of smooth patches between 40 and 215."""
    small = np.random.default_rng(seed).uniform(40, 215, (height // 20, width // 20, 3))
    return cv2.resize(small, (width, height)).astype(np.uint8)


def as_jpeg(image):
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=85)
    return np.asarray(Image.open(file))
