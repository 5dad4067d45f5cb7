"""Caches of backend results, mesh correspondences and networks in the user's cache folder."""

from __future__ import annotations
