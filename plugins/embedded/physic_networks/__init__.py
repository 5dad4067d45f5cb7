"""Functions and frozen dataclasses for plugins that wrap published networks, on NumPy arrays.

Images and cameras as in :mod:`physic_core.types`: integer pixel coordinates are pixel centres.
"""
