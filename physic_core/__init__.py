"""One photo in; people, scene and contact out, in one metric camera frame (OpenCV axes, metres)."""

from __future__ import annotations

from physic_core.hookspecs import hookimpl
from physic_core.registry import BackendRecord

__all__ = ["BackendRecord", "hookimpl"]
