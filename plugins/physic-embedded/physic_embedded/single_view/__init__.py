"""Focal length, gravity and depth offset from what one photo shows."""
