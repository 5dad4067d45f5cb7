"""Run MoGe-2 once for each photo and share the network and its outputs between backends."""

from __future__ import annotations

import hashlib
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakSet, WeakValueDictionary

import numpy as np

from physic_core.errors import BackendError
from physic_networks.pictures import normalized_nchw, resize_image

from .one_graph import GraphSignature, PortMatch, PortSpec, match_signature

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array

    from .sessions import Network

SIGNATURES = {
    "MoGe-2": GraphSignature(
        inputs=(
            PortSpec("image", dtype="float", shape=("batch", 3, "height", "width")),
            PortSpec("num_tokens", dtype=("int64", "int32")),
        ),
        outputs=(
            PortSpec("points", shape=("batch", "height", "width", 3)),
            PortSpec("normal", shape=("batch", "height", "width", 3), optional=True),
            PortSpec("mask", shape=("batch", "height", "width")),
            # The published files say "scale", what upstream's instructions export says
            # "metric_scale".
            PortSpec("metric_scale", ("scale",)),
        ),
        by_position=True,
    )
}
_PATCH = 14  # px
_LEAST_SHARE = 0.85  # of the tokens
_MOST_SQUASH = 0.01  # by which the aspect may change, as a logarithm
_CACHE_SIZE = 2  # photos; the output for the inpainted one is needed again after the original


@dataclass(frozen=True)
class AffinePoints:
    """Output of MoGe-2 at network resolution: points up to a scale and a shift along z, confidence,
    and metric scale.

    Attributes:
        points: (h, w, 3) float32, right up to a scale and a shift along z.
        confidence: (h, w) float32, of being a surface at all; sky is below 0.5.
        scale: metres a unit of the points.
        provider: what computed it.
    """

    points: FloatArray
    confidence: FloatArray
    scale: float
    provider: str

    @property
    def mask(self) -> BoolArray:
        """Mask (h, w) of valid points."""
        surface: BoolArray = self.confidence > 0.5
        return surface


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


@dataclass(frozen=True, eq=False)
class OpenMoge:
    """Open MoGe-2, closed by the last backend that releases it.

    Attributes:
        identity: file and device.
        network: of the file.
        ports: its inputs and outputs by our names.
    """

    identity: Hashable
    network: Network
    ports: PortMatch


class SharedMoge:
    """Open networks and the latest outputs, shared by backends with equal settings and thread-safe.

    Attributes:
        members: backends that ask or will ask; outputs are kept while there is one.
    """

    def __init__(self) -> None:
        self.members: WeakSet[object] = WeakSet()
        self._lock = threading.RLock()
        self._open: WeakValueDictionary[Hashable, OpenMoge] = WeakValueDictionary()
        self._outputs: OrderedDict[Hashable, AffinePoints] = OrderedDict()

    def open(self, identity: Hashable, opener: Callable[[], Network]) -> OpenMoge:
        """Return the network of a file on a device; ``opener`` is called only if it is not open.

        Raises:
            BackendError: it is not a MoGe-2.
        """
        with self._lock:
            found = self._open.get(identity)
            if found is None:
                network = opener()
                _, ports = match_signature(network, SIGNATURES)
                fixed = [size for size in ports.inputs["image"].shape[2:] if isinstance(size, int)]
                if fixed:
                    raise BackendError(
                        f"{network.name} was exported for photos of one size, {fixed}: export it "
                        "with free height and width (dynamic_axes), or use a published file, see "
                        "`physic weights list`"
                    )
                found = self._open[identity] = OpenMoge(identity, network, ports)
            return found

    def release(self, backend: object) -> None:
        """Drop the outputs if no other backend will ask for them."""
        with self._lock:
            self.members.discard(backend)
            if not self.members:
                self._outputs.clear()

    def run(self, moge: OpenMoge, image: UInt8Array, tokens: int) -> AffinePoints:
        """Return the network output for a photo (H, W, 3), of an earlier call if possible."""
        pixels = np.ascontiguousarray(image)
        key = (moge.identity, tokens, pixels.shape, hashlib.blake2b(pixels.data).digest())
        with self._lock:
            if key not in self._outputs:
                self._outputs[key] = _run(moge.network, moge.ports, pixels, tokens)
            self._outputs.move_to_end(key)
            while len(self._outputs) > _CACHE_SIZE:
                self._outputs.popitem(last=False)
            return self._outputs[key]


_LOCK = threading.Lock()
_RUNNERS: WeakValueDictionary[Hashable, SharedMoge] = WeakValueDictionary()


def shared_moge(*settings: Hashable) -> SharedMoge:
    """Return the MoGe-2 network that backends with equal settings share."""
    with _LOCK:
        runner = _RUNNERS.get(settings)
        if runner is None:
            runner = _RUNNERS[settings] = SharedMoge()
        return runner


def _run(network: Network, match: PortMatch, image: UInt8Array, tokens: int) -> AffinePoints:
    """Run the network on a photo and check its outputs."""
    height, width, tokens = network_input_size(image.shape[0], image.shape[1], tokens)
    seen = resize_image(image, height, width, "bilinear-antialias")
    feed: dict[str, NDArray[np.generic]] = {
        "image": normalized_nchw(seen),  # the graph subtracts mean and divides by deviation itself
        # The published files take it without dimensions, and refuse one of shape (1,).
        "num_tokens": np.full((1,) * len(match.inputs["num_tokens"].shape), tokens, np.int64),
    }
    points, confidence, scale = match.run(network, feed, ["points", "mask", "metric_scale"])
    if points.shape != (1, *seen.shape) or confidence.shape != points.shape[:3]:
        raise BackendError(
            f"{network.name} returned points {points.shape} and a mask {confidence.shape} for "
            f"{seen.shape[1]} x {seen.shape[0]} px: it was exported for other sizes, or is not "
            "MoGe-2"
        )
    metres = float(np.reshape(scale, -1)[0])
    if not 0 < metres < np.inf:
        raise BackendError(
            f"{network.name} returned a scale of {metres}, which has to be a number above 0"
        )
    return AffinePoints(
        np.asarray(points[0], np.float32),
        np.asarray(confidence[0], np.float32),
        metres,
        network.provider,
    )
