"""Type aliases of NumPy arrays by dtype, for type checkers only: at run time NumPy is not imported."""

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
