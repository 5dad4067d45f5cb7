"""Atomic writes, npz archives with verified checksums, and JSON with non-finite numbers."""
