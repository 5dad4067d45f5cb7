"""Backends of bodies, hands, contact and point maps that run published code or TorchScript files on
the user's disk.
"""
