"""Estimate depth, points and focal length with MoGe-2 (Wang et al. 2025).

The network returns points up to a scale and a shift along z, a mask, and the scale in metres. Focal
length and shift are computed here (:mod:`physic_networks.affine_pointmap`). The two backends
share network and outputs, so that each photo is run once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field

from physic_core.interfaces import MetricDepth, Options, RelativePointmap
from physic_core.types import CameraTrust, DepthMap, Intrinsics, Pointmap
from physic_networks.affine_pointmap import half_diagonal, points_on_rays, recover_camera
from physic_networks.networks import NetworkBackend
from physic_networks.pictures import resize_map

from .moge_network import OpenMoge, SharedMoge, shared_moge
from .sessions import OnnxOptions, open_network

if TYPE_CHECKING:
    from pydantic import BaseModel

    from physic_core.types import AffineAmbiguity, Hints, UInt8Array

_FILE = "model.onnx"


class MogeOptions(OnnxOptions):
    """Settings of MoGe-2; backends with equal settings share their network."""

    weights: str = Field(
        "moge-2-vits-normal",
        description="a name of `physic weights list`, or the path of a file of your own",
    )
    tokens: int = Field(
        1800,
        ge=1200,
        le=3600,
        description="number of patches of a photo; 1200 is fast, 3600 shows most detail and takes "
        "three times as long",
    )


class _Moge(NetworkBackend):
    """Base class of both MoGe-2 backends."""

    Options: ClassVar[type[Options]] = MogeOptions
    options: MogeOptions
    reads = ("intrinsics",)
    capabilities: ClassVar[frozenset[str]] = frozenset({"returns_intrinsics"})

    def __init__(self, options: BaseModel | None = None) -> None:
        super().__init__(options)
        chosen = self.options
        self.runner: SharedMoge = shared_moge(chosen.weights, chosen.provider, chosen.threads)
        self.runner.members.add(self)

    def build(self, device: str) -> OpenMoge:
        """Open the network, or share it if it is open."""
        path = self.file(_FILE)
        status = path.stat()
        identity = (str(path), status.st_size, status.st_mtime_ns, device)
        self.runner.members.add(self)
        return self.runner.open(identity, lambda: open_network(path, self.options, device))

    def close(self) -> None:
        """Release the network."""
        super().close()
        self.runner.release(self)

    def _ask(self, image: UInt8Array, known: Intrinsics | None, *, metric: bool) -> Pointmap:
        """Return the points of a photo on the rays of the known or the estimated camera.

        The shift along z is found with the focal length, so that only a scale is left unknown; for
        a flat scene that determines neither, the shift stays unknown too.

        Raises:
            BackendError: the backend is not loaded, or the output of the network is unusable.
        """
        height, width = image.shape[:2]
        raw = self.runner.run(self.network, image, self.options.tokens)
        seen_height, seen_width = raw.mask.shape
        notes = [f"MoGe-2 ran on {raw.provider}"]
        if known is not None:
            focal = (known.fx * seen_width / width, known.fy * seen_height / height)
            found = recover_camera(raw.points, raw.mask, focal)
            camera = known
        else:
            found = recover_camera(raw.points, raw.mask)
            focal_px = (
                found.fx * half_diagonal(height, width) / half_diagonal(seen_height, seen_width)
            )
            camera = Intrinsics.from_focal(focal_px, width, height, "MoGe-2")
            if not found.determined:
                source = "default: MoGe-2 saw a scene too flat to tell"
                camera = replace(camera, source=source, trust=CameraTrust.GUESSED)
                notes.append(
                    f"MoGe-2 saw a scene too flat to tell the focal length: {focal_px:.0f} px is "
                    f"a guess"
                )
        mask = resize_map(raw.confidence, height, width) > 0.5
        depth = resize_map(raw.points[..., 2], height, width)
        points, valid = points_on_rays(depth, mask, found, camera, raw.scale if metric else 1.0)
        unknown: AffineAmbiguity = "scale" if found.determined else "scale_shift"
        return Pointmap(points, valid, unknown, camera, tuple(notes))


class Moge2Depth(_Moge, MetricDepth):
    """Metric depth by MoGe-2, in the camera of ``hints``; if that camera is a default, in the
    estimated camera.
    """

    written_for = 1

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Predict the metric depth (H, W) of an image (H, W, 3), and its camera.

        Raises:
            BackendError: it is not loaded, or sees no surface at all.
        """
        known = hints.intrinsics
        if known is not None and known.guessed:
            known = None
        solved = self._ask(image, known, metric=True)
        return DepthMap(solved.points[..., 2].copy(), solved.intrinsics, notes=solved.notes)


class Moge2Pointmap(_Moge, RelativePointmap):
    """Relative point map by MoGe-2, without its metric scale."""

    written_for = 1

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Predict the relative point map of an image (H, W, 3), and its camera.

        Raises:
            BackendError: it is not loaded, or sees no surface at all.
        """
        return self._ask(image, hints.intrinsics, metric=False)
