"""Shapes of arrays as metadata of fields; type aliases by dtype, for type checkers only: NumPy is not imported."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Any

    import numpy as np
    from numpy.typing import NDArray

    BoolArray = NDArray[np.bool_]
    FloatArray = NDArray[np.floating[Any]]
    IntArray = NDArray[np.integer[Any]]
    UInt8Array = NDArray[np.uint8]


def shape(*sizes: str | int) -> dict[str, tuple[str | int, ...]]:
    """Return the metadata of a field whose array has this shape; one letter stands for one size in all fields."""
    return {"shape": sizes}
