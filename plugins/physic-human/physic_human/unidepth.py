"""Estimate metric depth, and the camera where unknown, with a checkout of UniDepth V2 (Piccinelli et al. 2025)."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, Options
from physic_core.types import DepthMap, Intrinsics
from physic_human.checkout_backend import CheckoutBackend, CheckoutOptions, CheckoutProject, inference_context, to_numpy

if TYPE_CHECKING:
    from physic_core.types import FloatArray, Hints, UInt8Array

_HALF_PIXEL = 0.5
"""Offset of pixel centres in UniDepth's image coordinates, px."""
_FARTHEST_M = 1e4


class UniDepthOptions(CheckoutOptions):
    """Settings of UniDepth V2."""

    weights: str = Field(
        default="unidepth-v2-vitl14",
        description="a name of `physic weights list`, or a folder with config.json and model.safetensors",
    )
    resolution_level: int = Field(default=9, ge=0, le=9, description="9 sees the finest details, 0 is fastest")
    use_camera: bool = Field(default=True, description="give the network the camera where it is known")


class UniDepth(CheckoutBackend, MetricDepth):
    """Metric depth and camera by UniDepth V2."""

    Options: ClassVar[type[Options]] = UniDepthOptions
    options: UniDepthOptions
    reads = ("intrinsics",)
    capabilities = frozenset({"returns_intrinsics"})
    project: ClassVar[CheckoutProject] = CheckoutProject(
        "UniDepth",
        "unidepth.models",
        "https://github.com/lpiccinelli-eth/UniDepth",
        ("torchvision", "einops", "timm", "huggingface_hub", "wandb", "matplotlib"),
        "8d8cfe4c7ee15297099983607febf0d4f32eb3d6",
    )

    def _build(self, device: str) -> None:
        """Build the network and load its weights from a folder."""
        folder = self._checkout_network.file()
        kind = self._checkout_network.checkout.attribute("UniDepthV2")
        with inference_context(self._checkout_network.checkout, device):
            network = kind.from_pretrained(str(folder))
            network.resolution_level = self.options.resolution_level
            network.interpolation_mode = "bilinear"
            self._checkout_network.set_network(network, device)

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return z-depth in metres of an image (H, W, 3).

        Raises:
            BackendError: it is not loaded, or the network answers something else.
        """
        network = self._checkout_network.loaded()
        height, width = image.shape[:2]
        known_camera = hints.intrinsics if self.options.use_camera else None
        if known_camera is not None and known_camera.guessed:
            known_camera = None  # a guess of others is no better than its own
        answer = self._run(network, image, known_camera)
        depth = to_numpy(answer["depth"]).reshape(-1)
        if depth.size != height * width:
            raise BackendError(f"UniDepth returned {depth.size} depths for {width} x {height} px")
        depth = depth.reshape(height, width)
        known = np.isfinite(depth) & (depth > 0) & (depth < _FARTHEST_M)
        camera = known_camera or _camera(to_numpy(answer["intrinsics"]), width, height)
        return DepthMap(np.where(known, depth, np.nan).astype(np.float32), camera)

    def _run(self, network: Any, image: UInt8Array, known_camera: Intrinsics | None) -> dict[str, Any]:
        """Run the network."""
        import torch

        rgb = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))
        camera = None
        if known_camera is not None:
            matrix = known_camera.matrix.astype(np.float32)
            matrix[:2, 2] += _HALF_PIXEL
            camera = torch.from_numpy(matrix)[None]  # its own: the network's code writes into it
        # Its own decorators would compute in float16 on every GPU, whatever is asked for.
        infer = inspect.unwrap(type(network).infer)
        with inference_context(self._checkout_network.checkout, self._checkout_network.device, half=self.options.half):
            answer = infer(network, rgb, camera)
        if not isinstance(answer, dict) or not {"depth", "intrinsics"} <= answer.keys():
            raise BackendError(
                f"UniDepth returned {type(answer).__name__} without depth and intrinsics: "
                "take the checkout of https://github.com/lpiccinelli-eth/UniDepth"
            )
        return answer


def _camera(matrix: FloatArray, width: int, height: int) -> Intrinsics:
    """Convert a camera matrix (1, 3, 3) or (3, 3) that counts from pixel edges."""
    k = matrix.reshape(-1, 3, 3)[0].astype(float)
    if not (np.isfinite(k).all() and k[0, 0] > 0 and k[1, 1] > 0):
        raise BackendError(f"UniDepth returned a camera without a focal length: {k.tolist()}")
    return Intrinsics(k[0, 0], k[1, 1], k[0, 2] - _HALF_PIXEL, k[1, 2] - _HALF_PIXEL, width, height, "UniDepth V2")
