"""Mock backends of all interfaces: ground truth of a synthetic world with random errors."""

from __future__ import annotations

__all__ = ["NOISE_VERSION"]

NOISE_VERSION = "4"
"""Version of the error models; do not compare results of different versions."""
