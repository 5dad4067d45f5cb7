"""Write ONNX files of networks whose licence forbids redistribution: ``python -m physic_onnx.export``.

A user who has the licence runs it. Checkout and checkpoint are the user's own. The file is written where the backends
look for it. torch's tracing exporter is used, because the newer one cannot export these networks.
"""

from __future__ import annotations

__all__: list[str] = []
