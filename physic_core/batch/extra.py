"""Import of pyarrow, an optional dependency."""

from __future__ import annotations

import importlib
from typing import Any

from physic_core.errors import PackageMissingError

__all__ = ["import_pyarrow"]


def import_pyarrow(purpose: str) -> Any:
    """Import ``pyarrow.parquet``.

    Raises:
        PackageMissingError: it is not installed; ``purpose`` begins the message.
    """
    try:
        return importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise PackageMissingError(
            f"{purpose} needs pyarrow: pip install pyarrow, or use a CSV file (--table csv)"
        ) from error
