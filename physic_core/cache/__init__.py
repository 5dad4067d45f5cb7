"""Keeps what took long to compute in the user's folder for caches, so that it is computed once."""

from __future__ import annotations
