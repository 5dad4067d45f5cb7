"""Packaged networks: opening, preprocessing and decoding."""
