"""Estimate a relative point map with a checkout of MoGe 1 (Wang et al. 2025), as in the PhySIC paper.

The network returns points up to a scale and a shift along z. Focal length and shift are computed here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.adapters.affine_pointmap import points_on_rays, recover_camera
from physic_core.adapters.pictures import normalized_nchw
from physic_core.errors import BackendError
from physic_core.interfaces import Options, RelativePointmap
from physic_core.types import Pointmap
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions, CheckoutProject, inference_context, to_numpy

if TYPE_CHECKING:
    from physic_core.types import BoolArray, FloatArray, Hints, UInt8Array

_LEVELS = 9


class Moge1Options(CheckoutOptions):
    """Settings of MoGe 1."""

    weights: str = Field(
        default="moge-1-vitl", description="a name of `physic weights list`, or the path of a model.pt"
    )
    resolution_level: int = Field(default=9, ge=0, le=9, description="9 sees the finest details, 0 is fastest")


class Moge1(CheckoutBackend, RelativePointmap):
    """Relative point map by MoGe 1, up to a scale, on the pixel rays of the given camera or else the estimated one."""

    Options: ClassVar[type[Options]] = Moge1Options
    options: Moge1Options
    reads = ("intrinsics",)
    capabilities = frozenset({"returns_intrinsics"})
    project: ClassVar[CheckoutProject] = CheckoutProject(
        "MoGe",
        "moge.model.v1",
        "https://github.com/microsoft/MoGe",
        ("utils3d", "huggingface_hub"),
        "07444410f1e33f402353b99d6ccd26bd31e469e8",
    )

    def _build(self, device: str) -> None:
        """Build the network and load its weights."""
        path = self._checkout_network.file()
        kind = self._checkout_network.checkout.attribute("MoGeModel")
        with inference_context(self._checkout_network.checkout, device):
            network = kind.from_pretrained(str(path))  # an existing path: nothing is fetched
            self._checkout_network.set_network(network, device)

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return the point map, up to a scale, of an image (H, W, 3).

        Raises:
            BackendError: it is not loaded, or no camera fits what the network answers.
        """
        points, mask = self._run(self._checkout_network.loaded(), image)
        height, width = mask.shape
        given = hints.intrinsics
        found = recover_camera(points, mask, None if given is None else (given.fx, given.fy))
        source = "MoGe" if found.determined else "default: MoGe saw a scene too flat to tell"
        camera = given or found.intrinsics(width, height, source)
        settled, valid = points_on_rays(points[..., 2], mask, found, camera)
        if found.determined:
            return Pointmap(settled, valid, "scale", camera)
        return Pointmap(settled, valid, "scale_shift", camera, ("MoGe saw a scene too flat to tell the focal length",))

    def _run(self, network: Any, image: UInt8Array) -> tuple[FloatArray, BoolArray]:
        """Run the network: affine points (H, W, 3) and their mask (H, W)."""
        import torch

        low, high = network.num_tokens_range
        tokens = int(low + self.options.resolution_level / _LEVELS * (high - low))
        # Red, green and blue from 0 to 1: the network subtracts mean and divides by deviation itself.
        pixels = torch.from_numpy(normalized_nchw(image)).to(self._checkout_network.device)
        with inference_context(self._checkout_network.checkout, self._checkout_network.device, half=self.options.half):
            answer = network.forward(pixels, tokens)
        try:
            points, mask = to_numpy(answer["points"])[0], to_numpy(answer["mask"])[0]
        except (KeyError, TypeError, IndexError) as error:
            raise BackendError(
                f"MoGe returned {type(answer).__name__} without points and mask: "
                "take the checkout of https://github.com/microsoft/MoGe"
            ) from error
        if points.shape != image.shape or mask.shape != image.shape[:2]:
            raise BackendError(f"MoGe returned points {points.shape} and a mask {mask.shape} for {image.shape}")
        counts: BoolArray = (mask > network.mask_threshold) & np.isfinite(points).all(axis=-1)
        return points, counts
