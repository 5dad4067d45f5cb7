"""Textures of bodies with the colours of the photo; loaded only for output that is meant for
eyes.
"""
