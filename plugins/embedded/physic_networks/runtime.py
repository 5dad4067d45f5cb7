"""onnxruntime, which is imported when it is first needed."""

from typing import Any


def onnxruntime() -> Any:
    """Return onnxruntime."""
    import onnxruntime

    return onnxruntime
