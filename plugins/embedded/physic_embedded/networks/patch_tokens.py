"""Tokens of an image encoder: where they are read, and how one backend leaves them for another."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakSet

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Hashable

    from numpy.typing import NDArray

    from physic_core.types import Float32Array, FloatArray
    from physic_networks.pictures import Letterbox


@dataclass(frozen=True)
class PatchTokens:
    """Tokens of the square patches of a letterboxed photo.

    Attributes:
        grid: (h, w, C) one token for each patch of the canvas.
        patch: side of a patch, px of the canvas.
        photo: position of the photo in the canvas.
    """

    grid: FloatArray
    patch: int
    photo: Letterbox

    @property
    def photo_grid(self) -> FloatArray:
        """The tokens (h, w, C) of the patches that show the photo."""
        (left, top), (right, bottom) = self._bounds()
        return self.grid[top:bottom, left:right]

    def mean_around(self, points: FloatArray, reach: int = 1) -> FloatArray:
        """Return the mean token (N, C) of the patches at most ``reach`` from the one at each point.

        Args:
            points: (N, 2) x y px of the photo; a point outside counts as the nearest inside.
            reach: patches to each side; 1 takes 3 x 3 of them, fewer at the edge of the photo.
        """
        first, end = self._bounds()
        column, row = np.clip(self._cells(points), first, end - 1).astype(int).T
        return self._means(row - reach, row + reach + 1, column - reach, column + reach + 1)

    def mean_in_boxes(self, boxes: FloatArray) -> FloatArray:
        """Return the mean token (N, C) of the patches that boxes (N, 4) x0 y0 x1 y1 px touch."""
        first, end = self._bounds()
        low = np.clip(self._cells(boxes[:, :2] - 0.5), first, end - 1)
        high = np.clip(self._cells(boxes[:, 2:] - 0.5), first, end)
        left, top = np.floor(low).astype(int).T
        right, bottom = np.ceil(high).astype(int).T
        return self._means(top, np.maximum(bottom, top + 1), left, np.maximum(right, left + 1))

    def _cells(self, points: FloatArray) -> FloatArray:
        """Return the place (N, 2) x y of points of the photo in the grid, in patches."""
        return (self.photo.to_canvas(np.asarray(points, np.float64)) + 0.5) / self.patch

    def _bounds(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Return the first column and row of patches that show the photo, and those after the
        last.
        """
        first = np.array([self.photo.left, self.photo.top])
        end = first + self.photo.inner[::-1]
        return first // self.patch, np.minimum(-(-end // self.patch), self.grid.shape[1::-1])

    def _means(
        self,
        top: NDArray[np.int_],
        bottom: NDArray[np.int_],
        left: NDArray[np.int_],
        right: NDArray[np.int_],
    ) -> FloatArray:
        """Return the mean token (N, C) of N half-open rectangles of patches."""
        (first_column, first_row), (columns, rows) = self._bounds()
        means = [
            self.grid[
                max(t, first_row) : min(b, rows), max(x, first_column) : min(r, columns)
            ].mean((0, 1))
            for t, b, x, r in zip(top, bottom, left, right, strict=True)
        ]
        return np.array(means, np.float64).reshape(-1, self.grid.shape[2])


class TokenStore:
    """Tokens of passes of an encoder, kept until they are taken; thread-safe.

    Attributes:
        readers: backends that take tokens; for each of them those of one pass are kept.
    """

    def __init__(self) -> None:
        self.readers: WeakSet[object] = WeakSet()
        self._lock = threading.Lock()
        self._kept: OrderedDict[Hashable, Float32Array] = OrderedDict()

    def put(self, key: Hashable, tokens: Float32Array) -> None:
        """Keep the tokens of a pass, in place of the oldest if no reader is left for them."""
        with self._lock:
            self._kept[key] = tokens
            while len(self._kept) > len(self.readers):
                self._kept.popitem(last=False)

    def take(self, key: Hashable) -> Float32Array | None:
        """Return and drop the tokens of a pass; None if they are not kept."""
        with self._lock:
            return self._kept.pop(key, None)
