"""Pairs of points on the outlines of bodies and masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.floating]
    IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class OutlinePairs:
    """Pairs of a body vertex and a line in the picture; N people, P pairs.

    The residual of a pair is ``normal @ (pixel of the vertex) - offset``, in sizes of the person;
    only a positive one counts.

    Attributes:
        vertex_ids: (V,) of the body model.
        vertex: (N, P) rows of ``vertex_ids``.
        normal: (N, P, 2) per px.
        offset: (N, P).
        weight: (N, P), zero for pairs that do not count.
    """

    vertex_ids: IntArray
    vertex: IntArray
    normal: FloatArray
    offset: FloatArray
    weight: FloatArray
