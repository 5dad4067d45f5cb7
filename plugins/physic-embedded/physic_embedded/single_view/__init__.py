"""Focal length, gravity and disparity offset estimated from a single photo."""
