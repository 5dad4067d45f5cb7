"""Caches of slow computations in the user's cache folder."""

from __future__ import annotations
