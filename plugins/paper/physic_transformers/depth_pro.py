"""Estimate metric depth and the focal length with DepthPro in Hugging Face transformers.

The class in transformers returns inverse depth and a field of view.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from physic_core.errors import BackendError, DeviceError
from physic_core.interfaces import MetricDepth
from physic_core.types import DepthMap, Intrinsics
from physic_networks.canonical_depth import (
    depth_from_canonical_inverse,
    focal_from_fov,
    known_camera,
)
from physic_networks.networks import WEIGHTS_HELP, picture_tensor, to_numpy
from physic_networks.pictures import resize_map
from physic_transformers.models import ModelOptions, ModelSpec, PretrainedBackend

if TYPE_CHECKING:
    from physic_core.types import Hints, UInt8Array

_LARGE = 1536  # px of the published input; 35 patches of it go through the network at once
_TELLING = 0.1  # share by which two focal lengths differ before it is worth a note


class DepthProOptions(ModelOptions):
    """Settings of :class:`DepthPro`."""

    weights: str = Field(default="depth-pro-hf", description=f"DepthPro: {WEIGHTS_HELP}.")
    use_known_focal: bool = Field(
        default=True,
        description="Scale depth to the focal length of the photo, its "
        "file or the user, if known; false keeps DepthPro's estimate.",
    )
    farthest: float = Field(
        default=1000.0,
        ge=1e-6,
        le=1e6,
        description="Meters; depth beyond this is unknown: DepthPro puts the sky at 10 km.",
    )
    cpu_memory_gb: float = Field(
        default=18.0,
        ge=0,
        le=1e6,
        description="Memory that a machine without a GPU must have, or loading is refused: with "
        "less, the system ends "
        "the whole run. 0 refuses nothing.",
    )


class DepthPro(PretrainedBackend, MetricDepth):
    """Metric depth and camera by DepthPro. On a CPU it takes minutes and about 18 GB of memory."""

    written_for = 1
    Options = DepthProOptions
    options: DepthProOptions
    reads = ("intrinsics",)
    capabilities = frozenset({"returns_intrinsics"})
    specs = (ModelSpec("weights", "DepthProForDepthEstimation", ("depth_pro",)),)

    def load(self, device: str = "cpu") -> None:
        """Read the weights.

        Raises:
            WeightsMissingError: they are not on this machine.
            DeviceError: the device is not there, or the machine has not enough memory to do without
                a GPU.
            BackendError: they are another model's.
        """
        super().load(device)
        available_gb = memory_gb()
        needed = self.options.cpu_memory_gb
        if (
            device == "cpu"
            and available_gb is not None
            and available_gb < needed
            and _input_side(self.model().config) >= _LARGE
        ):
            self.close()
            raise DeviceError(
                f"DepthPro needs about {needed:g} GB of memory on a CPU, this machine has "
                f"{available_gb:.0f} GB: use a GPU, another metric_depth, or set cpu_memory_gb = 0 "
                "to try all the same"
            )

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return z-depth in metres of an image (H, W, 3), and its camera.

        Raises:
            InputError: it is not a valid photo.
            BackendError: ``load`` was not called, or no focal length is known.
        """

        height, width = image.shape[:2]
        network = self.model()
        out = network.run(pixel_values=preprocess(image, _input_side(network.config), self.device))
        camera, notes = self._camera(
            _degrees(out.field_of_view), known_camera(hints, image), width, height
        )
        inverse = resize_map(to_numpy(out.predicted_depth)[0], height, width)
        depth = depth_from_canonical_inverse(inverse, camera.fx, width)
        near = np.where(depth < self.options.farthest, depth, np.nan)
        return DepthMap(near.astype(np.float32), camera, notes=notes)

    def _camera(
        self, degrees: float | None, known_camera: Intrinsics | None, width: int, height: int
    ) -> tuple[Intrinsics, tuple[str, ...]]:
        """Return the camera that scales the depth, and notes."""
        focal = None if degrees is None else focal_from_fov(degrees, width)
        if self.options.use_known_focal and known_camera is not None and not known_camera.guessed:
            if focal is None or abs(known_camera.fx / focal - 1) <= _TELLING:
                return known_camera, ()
            note = (
                f"DepthPro estimated a focal length of {focal:.0f} px; its depth is scaled to "
                f"{known_camera.fx:.0f} px"
            )
            return known_camera, (note,)
        if focal is None:
            raise BackendError(
                "DepthPro does not tell the focal length of this photo, and no other is known: "
                "give the camera, or take weights with the part for the field of view "
                "(use_fov_model), as the published ones have"
            )
        note = f"focal length {focal:.0f} px from DepthPro"
        return Intrinsics.from_focal(focal, width, height, "DepthPro"), (note,)


def _degrees(angle: Any) -> float | None:
    """Return the field of view, or None if the network predicts none or an invalid one."""
    if angle is None:
        return None
    degrees = float(to_numpy(angle).reshape(-1)[0])
    return degrees if math.isfinite(degrees) and 0 < degrees < 180 else None


def memory_gb() -> float | None:
    """Return the memory of this machine in GB, or None if unknown."""
    import os

    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
    except (AttributeError, ValueError, OSError):
        return None


def preprocess(image: UInt8Array, side: int, device: str = "cpu") -> Any:
    """Stretch an image (H, W, 3) to a tensor (1, 3, S, S) in [-1, 1], without antialiasing."""
    return picture_tensor(image, (0.5, 0.5, 0.5), (0.5, 0.5, 0.5), size=(side, side), device=device)


def _input_side(config: Any) -> int:
    """Return the side of the network's input: 1536 px for the published one."""
    return round(int(config.patch_size) / float(min(config.scaled_images_ratios)))
