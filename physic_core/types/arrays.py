"""Names for NumPy arrays by kind of number; for type checkers only, so that importing types imports no NumPy."""

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
