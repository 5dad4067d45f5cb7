"""The form in which results of backends are stored: arrays, and a JSON document of the rest."""

from __future__ import annotations

import copy
from typing import Any, TypeVar, get_origin

import numpy as np
from numpy.typing import NDArray

from physic_core import types
from physic_core.files.plain import Arrays, join, split

_T = TypeVar("_T")

KINDS = (
    types.Bodies,
    types.BodyParameters,
    types.ContactProbability,
    types.DepthMap,
    types.Hands,
    types.Intrinsics,
    types.Keypoints,
    types.Mesh,
    types.People,
    types.Pointmap,
    types.RestMesh,
    types.Skeleton,
    types.SurfaceLabels,
    types.UnposedPerson,
    NDArray[Any],
    tuple[NDArray[Any], ...],
)
"""Types of results that can be stored; the last one is that of networks."""


def canonicalize(result: _T) -> _T:
    """Convert a result to the form that the cache returns, so that runs with and without cache agree bit for bit.

    Arrays become C-contiguous copies, since their order in memory changes sums, and since the backend may use its
    arrays again; NumPy scalars become Python numbers. Of a result that cannot be stored, a deep copy is returned.
    """
    try:
        return restored(result, copies=True)
    except TypeError:
        return copy.deepcopy(result)


def restored(result: _T, *, copies: bool = False) -> _T:
    """Return a result as it is after it was stored, with its own arrays or with C-contiguous copies.

    Raises:
        TypeError: it cannot be stored.
    """
    arrays: Arrays = {}
    kind = next((one for one in KINDS if type(result) is (get_origin(one) or one)), None)
    if kind is None:
        raise TypeError(f"a {type(result).__name__} cannot be stored.")
    document = split(result, arrays)
    if any(array.dtype.hasobject for array in arrays.values()):
        raise TypeError("an array of Python objects cannot be stored.")
    if copies:
        arrays = {name: np.array(array, order="C") for name, array in arrays.items()}
    try:
        same: _T = join(kind, document, arrays)
    except ValueError as error:
        raise TypeError(f"{error}: it cannot be stored.") from error
    return same
