"""The photo that several tests show to the networks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

if TYPE_CHECKING:
    from numpy.typing import NDArray


@pytest.fixture(scope="session")
def image(pytestconfig: pytest.Config) -> NDArray[np.uint8]:
    """The example photo of two basketball players, (H, W, 3) RGB."""
    bgr = cv2.imread(str(pytestconfig.rootpath / "examples" / "basketball.png"))
    return np.ascontiguousarray(bgr[..., ::-1])
