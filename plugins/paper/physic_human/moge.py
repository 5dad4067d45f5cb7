"""Estimate depth and point maps with a checkout of MoGe 1 (Wang et al. 2025), the paper's, or
of MoGe-3 (2026).

The networks return points up to a scale and a shift along z, MoGe-3 also the scale in metres. Focal
length and shift are computed here.
"""

from __future__ import annotations

import importlib.util
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from physic_core.cache import cached_network_result
from physic_core.errors import BackendError
from physic_core.interfaces import (
    MetricDepth,
    RelativePointmap,
)
from physic_core.types import DepthMap, Pointmap
from physic_human.checkout_backend import (
    CheckoutBackend,
    CheckoutOptions,
    load_parameters,
    read_checkpoint,
)
from physic_networks.affine_pointmap import points_on_rays, recover_camera
from physic_networks.checkouts import Checkout
from physic_networks.networks import WEIGHTS_HELP, picture_tensor, to_numpy

if TYPE_CHECKING:
    import torch

    from physic_core.types import AnyArray, BoolArray, FloatArray, Hints, Intrinsics, UInt8Array

_TOO_FLAT = "finds the scene too flat to estimate the focal length"


class Moge1Options(CheckoutOptions):
    """Settings of MoGe 1."""

    weights: str = Field("moge-1-vitl", description=WEIGHTS_HELP)


class Moge3Options(CheckoutOptions):
    """Settings of MoGe-3."""

    weights: str = Field("moge-3-vitl", description=WEIGHTS_HELP)


class _MogeBackend(CheckoutBackend):
    """Base class of the MoGe backends."""

    title: ClassVar[str]
    reads = ("intrinsics",)
    capabilities = frozenset({"returns_intrinsics"})

    def preprocess(self, image: UInt8Array, hints: Hints) -> UInt8Array:
        """Return the image (H, W, 3)."""
        return image

    def _forward(self, image: UInt8Array, **settings: Any) -> Any:
        """Run the network with most tokens on red, green and blue from 0 to 1: it subtracts mean
        and divides by deviation itself.
        """
        tokens = int(self.network.num_tokens_range[1])
        pixels: torch.Tensor = picture_tensor(image, device=self.device)
        with self.inference():
            return self.network.forward(pixels, tokens, **settings)

    def _checked(self, output: Any, image: UInt8Array, *more: str) -> tuple[AnyArray, ...]:
        """Return points (H, W, 3), the probability of a surface (H, W), and further outputs of one
        image.

        Raises:
            BackendError: an output is missing or has another size.
        """
        names = ("points", "mask", *more)
        if not isinstance(output, dict) or not set(names) <= output.keys():
            got = ", ".join(sorted(output)) if isinstance(output, dict) else type(output).__name__
            raise BackendError(
                f"{self.title} returned {got}, expected {', '.join(names)}: take the checkout of "
                f"{self.project.homepage}, and weights with these heads"
            )
        points, chance, *rest = (np.asarray(to_numpy(output[name])[0]) for name in names)
        if points.shape != image.shape or chance.shape != image.shape[:2]:
            raise BackendError(
                f"{self.title} returned points {points.shape} and a mask {chance.shape} for "
                f"{image.shape}"
            )
        return points, chance, *rest

    def _place_on_rays(
        self,
        points: FloatArray,
        mask: BoolArray,
        known_camera: Intrinsics | None,
        scale: float = 1.0,
    ) -> Pointmap:
        """Place the points on the rays of the given camera, or else of the estimated one.

        The shift along z stays unknown where the points do not determine the focal length.
        """
        height, width = mask.shape
        solution = recover_camera(
            points, mask, None if known_camera is None else (known_camera.fx, known_camera.fy)
        )
        source = (
            self.title if solution.determined else f"default: {self.title} finds the scene too flat"
        )
        camera = known_camera or solution.intrinsics(width, height, source)
        placed, valid = points_on_rays(points[..., 2], mask, solution, camera, scale)
        if solution.determined:
            return Pointmap(placed, valid, "scale", camera)
        return Pointmap(placed, valid, "scale_shift", camera, (f"{self.title} {_TOO_FLAT}",))


class Moge1(_MogeBackend, RelativePointmap):
    """Relative point map by MoGe 1, up to a scale, on the pixel rays of the given camera or else
    the estimated one.
    """

    written_for = 1
    title = "MoGe"
    Options = Moge1Options
    options: Moge1Options
    project = Checkout(
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
            # an existing path: nothing is fetched
            return kind.from_pretrained(str(self.file())).eval().to(device)

    def run(self, inputs: Any) -> Any:
        """Run the network."""
        return self._forward(inputs)

    def postprocess(self, output: Any, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return the point map, up to a scale, of an image (H, W, 3)."""
        points, chance = self._checked(output, image)
        mask = (chance > self.network.mask_threshold) & np.isfinite(points).all(axis=-1)
        return self._place_on_rays(points, mask, hints.intrinsics)


_KERNELS = ("flex_gemm", "flex_gemm.nn", "flex_gemm.ops")  # import Triton, which needs a GPU
_TOOLS = ("utils3d", "utils3d_moge")  # imported under either name, and not used by the network


class _Moge3Backend(_MogeBackend):
    """Base class of both MoGe-3 backends, which run without its refiner."""

    title = "MoGe-3"
    Options = Moge3Options
    options: Moge3Options
    # A photo of 1280 x 960 px. Its weights stay in float32 in each precision.
    gpu_gigabytes = MappingProxyType({"float32": 3.5, "float16": 3.5, "bfloat16": 3.5})
    project = Checkout(
        name="MoGe-3",
        package="moge.model.v3",
        homepage="https://github.com/microsoft/MoGe",
        commit="74fbce054ebed49800de42d0ad0e83495065719a",
        needs=("huggingface_hub",),
    )

    def build(self, device: str) -> Any:
        """Build the network without its refiner, and load its weights.

        Raises:
            BackendError: the file is no checkpoint of MoGe-3, or lacks parameters.
        """
        absent = [name for name in _TOOLS if importlib.util.find_spec(name) is None]
        with _stand_in_modules(*_KERNELS, *absent):
            kind = self.checkout.attribute("MoGeModel")
        path = self.file()
        checkpoint = read_checkpoint(path, trusted=self.options.trust_checkpoint)
        if not isinstance(checkpoint, dict) or not {"model_config", "model"} <= checkpoint.keys():
            raise BackendError(
                f"{path} is no checkpoint of {self.title}: it lacks model_config or model"
            )
        config = {**checkpoint["model_config"], "refiner": None}
        with self.inference(), warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*refiner is not enabled")
            network = kind(**config)
        load_parameters(network, checkpoint["model"], path)
        return network.eval().to(device)

    def run(self, inputs: Any) -> Any:
        """Run the network, or take its outputs for this image from the cache: both interfaces need
        them.
        """
        made_of = f"{self.fingerprint()} {self.dtype} {self.device}"

        def compute() -> tuple[AnyArray, ...]:
            output = self._forward(inputs, refine_steps=0)
            return self._checked(output, inputs, "metric_scale")

        return cached_network_result("moge-3", made_of, {"image": inputs}, compute)

    def _pointmap_of_output(
        self, output: Any, known_camera: Intrinsics | None, *, metric: bool
    ) -> Pointmap:
        points, chance, scale = output
        if not 0 < float(scale) < np.inf:
            raise BackendError(
                f"{self.title} returned a scale of {float(scale)}, which has to be a number above 0"
            )
        mask = (chance > 0.5) & np.isfinite(points).all(axis=-1)
        return self._place_on_rays(points, mask, known_camera, float(scale) if metric else 1.0)


class Moge3Pointmap(_Moge3Backend, RelativePointmap):
    """Relative point map by MoGe-3, without its metric scale."""

    written_for = 1

    def postprocess(self, output: Any, image: UInt8Array, hints: Hints) -> Pointmap:
        """Return the point map, up to a scale, of an image (H, W, 3)."""
        return self._pointmap_of_output(output, hints.intrinsics, metric=False)


class Moge3Depth(_Moge3Backend, MetricDepth):
    """Metric depth by MoGe-3, in the camera of ``hints``; if that camera is a default, in the
    estimated camera.
    """

    written_for = 1

    def postprocess(self, output: Any, image: UInt8Array, hints: Hints) -> DepthMap:
        """Return the metric depth of an image (H, W, 3), and its camera."""
        given = hints.intrinsics
        if given is not None and given.guessed:
            given = None
        solved = self._pointmap_of_output(output, given, metric=True)
        camera = solved.intrinsics
        assert camera is not None
        notes = tuple(f"{note}: {camera.fx:.0f} px is a guess" for note in solved.notes)
        return DepthMap(solved.points[..., 2].copy(), camera, notes=notes)


@contextmanager
def _stand_in_modules(*names: str) -> Iterator[None]:
    """Let code import names from modules that it does not use: each is an empty
    ``torch.nn.Module``.
    """
    import torch

    def attribute(name: str) -> Any:
        if name.startswith("__"):  # of Python's own import
            raise AttributeError(name)
        return torch.nn.Module

    before = {name: sys.modules.get(name) for name in names}
    for name in names:
        module = ModuleType(name)
        module.__dict__["__getattr__"] = attribute
        sys.modules[name] = module
    try:
        yield
    finally:
        for name, module_before in before.items():
            if module_before is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module_before
