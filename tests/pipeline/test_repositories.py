"""A result names the checkouts that it was made with."""

from __future__ import annotations

import numpy as np
import pytest

from physic_core.interfaces import MetricDepth, Repository
from physic_core.types import DepthMap
from tests.pipeline.mocks import run

URL = "https://example.org/thing"


@pytest.mark.usefixtures("few_steps")
def test_a_result_names_its_checkouts_and_warns_of_others(world):
    class Depth(MetricDepth):
        def load(self, device="cpu"):
            pass

        def requirements(self):
            return (Repository("checkout", "Thing", URL, "b" * 40, "thing", "c" * 40, True),)

        def infer(self, image, hints):
            return DepthMap(np.full(image.shape[:2], 3.0, np.float32))

    found = run(world.image, backends={"metric_depth": Depth()})
    assert found.diagnostics["repositories"] == {URL: {"commit": "c" * 40, "state": "differs"}}
    assert any(f"checkout of {URL} is at ccccccc" in warning for warning in found.warnings)
