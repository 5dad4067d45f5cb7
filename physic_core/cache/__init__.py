"""Caches of backend results, mesh correspondences and body models in the user's cache folder."""

from __future__ import annotations
