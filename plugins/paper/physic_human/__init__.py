"""Backends of bodies, hands, contact and point maps that run published code on the user's disk."""
