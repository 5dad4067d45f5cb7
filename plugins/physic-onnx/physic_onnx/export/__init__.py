"""Export networks that may not be redistributed to ONNX by their licensed user: ``python -m physic_onnx.export``.

Checkout and checkpoint are the user's own. The file is written where the backends look for it. torch's tracing exporter
is used, because the newer one cannot export these networks.
"""

from __future__ import annotations

__all__: list[str] = []
