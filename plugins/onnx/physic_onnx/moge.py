"""Estimate depth, points and focal length with MoGe-2 (Wang et al. 2025).

The network returns points up to a scale and a shift along z, a mask, and the scale in metres. Focal
length and shift are computed here (:mod:`physic_networks.affine_pointmap`). The two backends
take the outputs for a photo from the cache of a run, so that each photo is run once.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from physic_core.cache import cached_network_result
from physic_core.errors import BackendError
from physic_core.interfaces import MetricDepth, RelativePointmap
from physic_core.types import CameraTrust, DepthMap, Intrinsics, Pointmap
from physic_networks.affine_pointmap import half_diagonal, points_on_rays, recover_camera
from physic_networks.networks import WEIGHTS_HELP
from physic_networks.pictures import normalized_nchw, resize_image, resize_map
from physic_networks.runtime import onnxruntime

from .sessions import OnnxBackend, OnnxOptions

if TYPE_CHECKING:
    from physic_core.types import AffineAmbiguity, AnyArray, Hints, UInt8Array

    from .sessions import Network

_PATCH = 14  # px
_LEAST_SHARE = 0.85  # of the tokens
_MOST_SQUASH = 0.01  # by which the aspect may change, as a logarithm
_SURE = 0.5  # confidence of being a surface at all; sky is below


class MogeOptions(OnnxOptions):
    """Settings of MoGe-2."""

    weights: str = Field("moge-2-vits-normal", description=WEIGHTS_HELP)
    tokens: int = Field(
        1800,
        ge=1200,
        le=3600,
        description="number of patches of a photo; 1200 is fast, 3600 shows most detail and takes "
        "three times as long",
    )


class _MogeBackend(OnnxBackend):
    """Base class of both MoGe-2 backends."""

    Options = MogeOptions
    options: MogeOptions
    reads = ("intrinsics",)
    capabilities = frozenset({"returns_intrinsics"})

    def _outputs(self, image: UInt8Array) -> tuple[AnyArray, ...]:
        """Return points (h, w, 3), up to a scale and a shift along z, confidence (h, w) of a
        surface, and metres a unit of the points, from the cache if the other backend has run.
        """
        runtime = f"{self.network.provider}, onnxruntime {onnxruntime().__version__}"
        made_of = f"{self.fingerprint()} {self.options!r} {runtime}"
        return cached_network_result(
            "moge-2",
            made_of,
            {"image": image},
            lambda: _run_network(self.network, image, self.options.tokens),
        )

    def _predict_pointmap(
        self, image: UInt8Array, known_camera: Intrinsics | None, *, metric: bool
    ) -> Pointmap:
        """Return the points of a photo on the rays of the known or the estimated camera.

        The shift along z is found with the focal length, so that only a scale is left unknown; for
        a flat scene that determines neither, the shift stays unknown too.

        Raises:
            BackendError: the backend is not loaded, or the output of the network is unusable.
        """
        height, width = image.shape[:2]
        xyz, confidence, scale = self._outputs(image)
        surface = confidence > _SURE
        seen_height, seen_width = surface.shape
        notes = [f"MoGe-2 ran on {self.network.provider}"]
        if known_camera is not None:
            focal = (known_camera.fx * seen_width / width, known_camera.fy * seen_height / height)
            solution = recover_camera(xyz, surface, focal)
            camera = known_camera
        else:
            solution = recover_camera(xyz, surface)
            focal_px = (
                solution.fx * half_diagonal(height, width) / half_diagonal(seen_height, seen_width)
            )
            camera = Intrinsics.from_focal(focal_px, width, height, "MoGe-2")
            if not solution.determined:
                source = "default: the scene is too flat for MoGe-2"
                camera = replace(camera, source=source, trust=CameraTrust.GUESSED)
                notes.append(
                    f"the scene is too flat for MoGe-2 to estimate the focal length: "
                    f"{focal_px:.0f} px is a guess"
                )
        mask = resize_map(confidence, height, width) > _SURE
        depth = resize_map(xyz[..., 2], height, width)
        points, valid = points_on_rays(
            depth, mask, solution, camera, float(scale) if metric else 1.0
        )
        unknown: AffineAmbiguity = "scale" if solution.determined else "scale_shift"
        return Pointmap(points, valid, unknown, camera, tuple(notes))


class Moge2Depth(_MogeBackend, MetricDepth):
    """Metric depth by MoGe-2, in the camera of ``hints``; if that camera is a default, in the
    estimated camera.
    """

    written_for = 1

    def infer(self, image: UInt8Array, hints: Hints) -> DepthMap:
        """Predict the metric depth (H, W) of an image (H, W, 3), and its camera.

        Raises:
            BackendError: it is not loaded, or sees no surface at all.
        """
        given = hints.intrinsics
        if given is not None and given.guessed:
            given = None
        solved = self._predict_pointmap(image, given, metric=True)
        return DepthMap(solved.points[..., 2].copy(), solved.intrinsics, notes=solved.notes)


class Moge2Pointmap(_MogeBackend, RelativePointmap):
    """Relative point map by MoGe-2, without its metric scale."""

    written_for = 1

    def infer(self, image: UInt8Array, hints: Hints) -> Pointmap:
        """Predict the relative point map of an image (H, W, 3), and its camera.

        Raises:
            BackendError: it is not loaded, or sees no surface at all.
        """
        return self._predict_pointmap(image, hints.intrinsics, metric=False)


def network_input_size(height: int, width: int, tokens: int) -> tuple[int, int, int]:
    """Return the height and width to which a photo is reduced, px, and the number of patches to ask
    for.

    The network resizes what it gets to patches of 14 px: with antialiasing in its authors' code,
    without in the files. So a larger photo is reduced here to whole patches, which the network then
    leaves as they are. Of the grids of at least :data:`_LEAST_SHARE` of ``tokens``, the one nearest
    to the photo's aspect is taken. If none is near, as for a narrow strip, the photo keeps its
    aspect and is resized twice.
    """
    factor = (tokens * _PATCH**2 / (height * width)) ** 0.5
    if factor >= 1:
        return height, width, tokens
    most = int(factor * height / _PATCH)
    grids = [
        (rows, round(rows * width / height))
        for rows in range(max(1, int(_LEAST_SHARE**0.5 * most)), most + 2)
    ]
    fits = [grid for grid in grids if _LEAST_SHARE * tokens <= grid[0] * grid[1] <= tokens]
    off, (rows, columns) = min(
        ((abs(math.log(c / r * height / width)), (r, c)) for r, c in fits),
        default=(math.inf, (0, 0)),
    )
    if off > _MOST_SQUASH:
        return max(1, round(height * factor)), max(1, round(width * factor)), tokens
    return rows * _PATCH, columns * _PATCH, rows * columns


def _run_network(network: Network, image: UInt8Array, tokens: int) -> tuple[AnyArray, ...]:
    """Run the network on a photo and check its outputs."""
    height, width, tokens = network_input_size(image.shape[0], image.shape[1], tokens)
    resized = resize_image(image, height, width, "bilinear-antialias")
    feed: dict[str, AnyArray] = {
        "image": normalized_nchw(
            resized
        ),  # the graph subtracts mean and divides by deviation itself
        "num_tokens": np.array(tokens, np.int64),  # of shape (1,) is refused
    }
    points, confidence, scale = network.run(feed, ["points", "mask", "scale"])
    metres = float(np.reshape(scale, -1)[0])
    if not 0 < metres < np.inf:
        raise BackendError(
            f"{network.name} returned a scale of {metres}, which has to be a number above 0"
        )
    return (
        np.asarray(points[0], np.float32),
        np.asarray(confidence[0], np.float32),
        np.array(metres),
    )
