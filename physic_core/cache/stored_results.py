"""The form in which results of backends are stored: arrays, and a JSON document of the rest."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

import numpy as np

from physic_core import types
from physic_core.files.archive import join_arrays, split_arrays

_T = TypeVar("_T")

_CLASSES = (
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
)


def canonicalize(result: _T) -> _T:
    """Convert a result to the form that the cache returns, so that runs with and without cache agree bit for bit.

    Arrays become C-contiguous copies, since their order in memory changes sums, and since the backend may use its
    arrays again; NumPy scalars become Python numbers. Of a result that cannot be stored, a deep copy is returned.
    """
    try:
        arrays, document = split_result(result)
    except TypeError:
        return copy.deepcopy(result)
    copies = {name: np.array(array, order="C") for name, array in arrays.items()}
    same: _T = restore_result(copies, document)
    return same


def split_result(result: object) -> tuple[dict[str, Any], Any]:
    """Split a result into C-contiguous arrays and a JSON-ready document.

    Raises:
        TypeError: it cannot be stored.
    """
    arrays, document = split_arrays(result)
    if any(array.dtype.hasobject for array in arrays.values()):
        raise TypeError("an array of Python objects cannot be stored.")
    restore_result(arrays, document)
    return {name: np.asarray(array, order="C") for name, array in arrays.items()}, document


def restore_result(arrays: dict[str, Any], document: Any) -> Any:
    """Restore a result from :func:`split_result`.

    Raises:
        TypeError: the document names another class, or does not fit its class.
    """
    try:
        return join_arrays(arrays, document, _CLASSES)
    except (KeyError, AttributeError) as error:
        raise TypeError(f"{error} cannot be part of a result.") from error
