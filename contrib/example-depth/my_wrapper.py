"""A wrapper of a network, and the same with a network that returns the truth of a photo."""

import numpy as np

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth
from physic_core.types import DepthMap
from physic_networks.canonical_depth import depth_from_canonical
from physic_networks.pictures import normalized_nchw, resize_image, resize_map
from physic_testing import world_of


class MyWrapper(MetricDepth):
    """Metric depth by a network for a canonical camera."""

    network = None  # load() opens the file here

    def infer(self, image, hints):
        if self.network is None:
            raise BackendError("not loaded")
        height, width = image.shape[:2]
        raw = self.network(normalized_nchw(resize_image(image, 384, 512)))
        focal = hints.intrinsics.fx * 512 / width if hints.intrinsics else 512.0
        return DepthMap(depth_from_canonical(resize_map(raw, height, width), focal, 500.0))


class WithTruth(MyWrapper):
    """The wrapper with a perfect network: what is wrong then is wrong in the wrapper."""

    capabilities = frozenset({"exact"})

    def load(self, device="cpu"):
        self.network = self.network or self.true_output

    def infer(self, image, hints):
        self.image = image
        return super().infer(image, hints)

    def true_output(self, pixels):
        """Return what the authors state: depth for a focal length of 500 px at 512 x 384 px."""
        assert pixels.shape == (1, 3, 384, 512), pixels.shape
        np.testing.assert_allclose(
            pixels.mean((0, 2, 3)), self.image.mean((0, 1)) / 255, atol=0.01
        )  # RGB, 0 to 1
        world = world_of(self.image)
        if world is None:
            return np.full((384, 512), 3.0, np.float32)
        height, width = world.empty_depth.shape
        rows = np.arange(384) * height // 384
        columns = np.arange(512) * width // 512
        metres = np.minimum(world.empty_depth[rows][:, columns], 1000)
        return metres * 500 / (world.intrinsics.fx * 512 / width)
