"""The photo that several tests show to the networks, and the people whom the segmenter finds in
it.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from physic_embedded.segmenter import EmbeddedSegmenter, EmbeddedSegmenterOptions


@pytest.fixture(scope="session")
def image(pytestconfig):
    """The example photo of two basketball players, (H, W, 3) RGB."""
    bgr = cv2.imread(str(pytestconfig.rootpath / "examples" / "basketball.png"))
    return np.ascontiguousarray(bgr[..., ::-1])


@pytest.fixture(scope="session")
def segmenter():
    backend = EmbeddedSegmenter(EmbeddedSegmenterOptions(threads=1))
    backend.load()
    yield backend
    backend.close()


@pytest.fixture(scope="session")
def people(segmenter, image):
    return segmenter.infer(image)
