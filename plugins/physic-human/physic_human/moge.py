"""Estimate a relative point map with a checkout of MoGe 1 (Wang et al. 2025), as in the PhySIC paper.

The network returns points up to a scale and a shift along z. Focal length and shift are computed here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.affine_pointmap import points_on_rays, recover_camera
from physic_core.adapters.checkouts import Checkout
from physic_core.adapters.networks import picture_tensor, to_numpy
from physic_core.errors import BackendError
from physic_core.interfaces import Options, RelativePointmap
from physic_core.types import Pointmap
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions

if TYPE_CHECKING:
    import torch

    from physic_core.types import BoolArray, Hints, UInt8Array

_LEVELS = 9


class Moge1Options(CheckoutOptions):
    """Settings of MoGe 1."""

    weights: str = Field(
        default="moge-1-vitl", description="a name of `physic weights list`, or the path of a model.pt"
    )
    resolution_level: int = Field(default=9, ge=0, le=9, description="9 sees the finest details, 0 is fastest")


class Moge1(CheckoutBackend, RelativePointmap):
    """Relative point map by MoGe 1, up to a scale, on the pixel rays of the given camera or else the estimated one."""

    written_for = 1
    Options: ClassVar[type[Options]] = Moge1Options
    options: Moge1Options
    reads = ("intrinsics",)
    capabilities: ClassVar[frozenset[str]] = frozenset({"returns_intrinsics"})
    project: ClassVar[Checkout] = Checkout(
        name="MoGe",
        package="moge.model.v1",
        homepage="https://github.com/microsoft/MoGe",
        commit="07444410f1e33f402353b99d6ccd26bd31e469e8",
        needs=("utils3d", "huggingface_hub"),
    )

    def build(self, device: str) -> Any:
        """Build the network and load its weights."""
        kind = self.checkout.attribute("MoGeModel")
        with self.inference():
            return kind.from_pretrained(str(self.file())).eval().to(device)  # an existing path: nothing is fetched

    def preprocess(self, image: UInt8Array, hints: Hints) -> torch.Tensor:
        """Return red, green and blue from 0 to 1: the network subtracts mean and divides by deviation itself."""
        pixels: torch.Tensor = picture_tensor(image, device=self.device)
        return pixels

    def run(self, inputs: Any) -> Any:
        """Run the network with the number of tokens of the resolution level."""
        low, high = self.network.num_tokens_range
        tokens = int(low + self.options.resolution_level / _LEVELS * (high - low))
        with self.inference():
            return self.network.forward(inputs, tokens)

    def postprocess(self, output: Any, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return the point map, up to a scale, of an image (H, W, 3)."""
        if not isinstance(output, dict) or not {"points", "mask"} <= output.keys():
            raise BackendError(
                f"MoGe returned {type(output).__name__} without points and mask: "
                f"take the checkout of {self.project.homepage}"
            )
        points, chance = to_numpy(output["points"])[0], to_numpy(output["mask"])[0]
        if points.shape != image.shape or chance.shape != image.shape[:2]:
            raise BackendError(f"MoGe returned points {points.shape} and a mask {chance.shape} for {image.shape}")
        mask: BoolArray = (chance > self.network.mask_threshold) & np.isfinite(points).all(axis=-1)
        height, width = mask.shape
        given = hints.intrinsics
        found = recover_camera(points, mask, None if given is None else (given.fx, given.fy))
        source = "MoGe" if found.determined else "default: MoGe saw a scene too flat to tell"
        camera = given or found.intrinsics(width, height, source)
        settled, valid = points_on_rays(points[..., 2], mask, found, camera)
        if found.determined:
            return Pointmap(settled, valid, "scale", camera)
        return Pointmap(settled, valid, "scale_shift", camera, ("MoGe saw a scene too flat to tell the focal length",))
