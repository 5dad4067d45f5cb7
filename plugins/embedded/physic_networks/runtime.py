"""onnxruntime, which is imported when it is first needed."""

import os
from typing import Any


def onnxruntime() -> Any:
    """Return onnxruntime without its telemetry.

    From 1.29 on its wheels tell their maker a number of the machine, the path of the program, and
    names, times and errors of networks. They begin when they are imported, so a variable must be
    set before. A user's own value is kept.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    return onnxruntime
