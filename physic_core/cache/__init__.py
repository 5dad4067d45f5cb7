"""Caches of backend results, mesh correspondences, networks and hashes in the user's cache folder."""

from __future__ import annotations
