"""What adapters of published networks share: pure functions and frozen dataclasses over numpy arrays.

Images and cameras as in :mod:`physic_core.types`: integer pixel coordinates are pixel centres.
"""
