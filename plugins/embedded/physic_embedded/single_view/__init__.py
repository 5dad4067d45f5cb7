"""Focal length, pitch and disparity offset estimated from a single photo."""
