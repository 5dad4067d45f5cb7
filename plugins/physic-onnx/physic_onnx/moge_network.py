"""Running MoGe-2: one network, and each photo once, for all backends that ask it the same."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary, WeakSet, WeakValueDictionary

import numpy as np

from physic_core.adapters.pictures import normalized_nchw, resize_image
from physic_core.errors import BackendError

from .contract import Dialect, Match, Wanted, choose

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from physic_core.types import BoolArray, FloatArray, UInt8Array

    from .sessions import Network

__all__ = ["DIALECTS", "AffinePoints", "MogeRunner", "runner_for", "size_seen"]

DIALECTS = {
    "MoGe-2": Dialect(
        inputs=(
            Wanted("image", dtype="float", shape=("batch", 3, "height", "width")),
            Wanted("num_tokens", dtype=("int64", "int32")),
        ),
        outputs=(
            Wanted("points", shape=("batch", "height", "width", 3)),
            Wanted("normal", shape=("batch", "height", "width", 3), optional=True),
            Wanted("mask", shape=("batch", "height", "width")),
            # The published files say "scale", what upstream's instructions export says "metric_scale".
            Wanted("metric_scale", ("scale",)),
        ),
        by_position=True,
    )
}
_PATCH = 14  # px
_KEPT = 2  # photos: the inpainted one is asked about again after the original


@dataclass(frozen=True)
class AffinePoints:
    """What the network answers, at the size at which it saw the photo.

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
        """(h, w) bool, the points that count."""
        surface: BoolArray = self.confidence > 0.5
        return surface


def size_seen(height: int, width: int, tokens: int) -> tuple[int, int]:
    """Height and width at which a photo is fed.

    The graph resizes whatever it gets to ``tokens`` patches of 14 px, without looking at the pixels in between: a
    larger photo has to be reduced before, and loses nothing by it.
    """
    factor = min(1.0, (tokens * _PATCH**2 / (height * width)) ** 0.5)
    return max(1, round(height * factor)), max(1, round(width * factor))


class MogeRunner:
    """An open network and its last answers, shared by backends.

    A backend says that it exists (``expect``), opens, and releases. The network is open while a backend holds it;
    answers are kept while one holds it or may still come to. Safe to be used by several threads.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._expected: WeakSet[object] = WeakSet()
        self._holders: WeakKeyDictionary[object, Hashable] = WeakKeyDictionary()
        self._networks: dict[Hashable, tuple[Network, Match]] = {}
        self._kept: OrderedDict[Hashable, AffinePoints] = OrderedDict()

    def expect(self, backend: object) -> None:
        """A backend that has not been loaded yet."""
        with self._lock:
            self._expected.add(backend)

    def open(self, backend: object, identity: Hashable, opener: Callable[[], Network]) -> None:
        """Hold the network for a backend; ``opener`` opens it if none of this identity (file, device) is open.

        Raises:
            BackendError: it is not a MoGe-2.
        """
        with self._lock:
            if identity not in self._networks:
                network = opener()
                _, match = choose(network, DIALECTS)
                fixed = [size for size in match.inputs["image"].shape[2:] if isinstance(size, int)]
                if fixed:
                    raise BackendError(
                        f"{network.name} was exported for photos of one size, {fixed}: export it with free height "
                        "and width (dynamic_axes), or use a published file, see `physic weights list`"
                    )
                self._networks[identity] = (network, match)
            self._expected.add(backend)
            self._holders[backend] = identity
            self._drop_unheld()

    def release(self, backend: object) -> None:
        """Let go of the network for a backend; the last one closes it."""
        with self._lock:
            self._holders.pop(backend, None)
            self._expected.discard(backend)
            self._drop_unheld()
            if not self._expected:
                self._kept.clear()

    def run(self, backend: object, image: UInt8Array, tokens: int) -> AffinePoints:
        """What the network says of a photo (H, W, 3); it is run unless it was asked the same before.

        Raises:
            BackendError: the backend does not hold it, or the network fails.
        """

        with self._lock:
            identity = self._holders.get(backend)
            if identity is None:
                raise BackendError("MoGe-2 is not loaded: call load() before infer()")
            pixels = np.ascontiguousarray(image)
            key = (identity, tokens, pixels.shape, hashlib.blake2b(pixels.data).digest())
            if key not in self._kept:
                self._kept[key] = _run(*self._networks[identity], pixels, tokens)
            self._kept.move_to_end(key)
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
            return self._kept[key]

    def _drop_unheld(self) -> None:
        held = set(self._holders.values())
        self._networks = {identity: opened for identity, opened in self._networks.items() if identity in held}


def runner_for(*settings: Hashable) -> MogeRunner:
    """The runner of all living backends with these settings; it goes when the last of them does."""
    with _LOCK:
        runner = _RUNNERS.get(settings)
        if runner is None:
            runner = _RUNNERS[settings] = MogeRunner()
        return runner


_LOCK = threading.Lock()
_RUNNERS: WeakValueDictionary[Hashable, MogeRunner] = WeakValueDictionary()


def _run(network: Network, match: Match, image: UInt8Array, tokens: int) -> AffinePoints:

    seen = resize_image(image, *size_seen(image.shape[0], image.shape[1], tokens), "bilinear-antialias")
    feed: dict[str, NDArray[np.generic]] = {
        "image": normalized_nchw(seen),  # the graph subtracts mean and divides by deviation itself
        # The published files take it without dimensions, and refuse one of shape (1,).
        "num_tokens": np.full((1,) * len(match.inputs["num_tokens"].shape), tokens, np.int64),
    }
    points, confidence, scale = match.run(network, feed, ["points", "mask", "metric_scale"])
    if points.shape != (1, *seen.shape) or confidence.shape != points.shape[:3]:
        raise BackendError(
            f"{network.name} answered points {points.shape} and a mask {confidence.shape} for {seen.shape[1]} x "
            f"{seen.shape[0]} px: it was exported for other sizes, or is no MoGe-2"
        )
    metres = float(np.reshape(scale, -1)[0])
    if not 0 < metres < np.inf:
        raise BackendError(f"{network.name} answered a scale of {metres}, which has to be a number above 0")
    return AffinePoints(
        np.asarray(points[0], np.float32), np.asarray(confidence[0], np.float32), metres, network.provider
    )
