"""Networks that may not be passed on, exported to ONNX by whoever has the licence: ``python -m physic_onnx.export``.

Checkout and checkpoints are the user's own; the file is written where the adapters look for it. torch's tracing
exporter is used: the newer one cannot export these networks.
"""

from __future__ import annotations

__all__: list[str] = []
