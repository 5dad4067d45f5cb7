"""Pure functions on tensors: cameras, point maps, alignment, planes, neighbours, visibility, robust losses.

Import the modules by name; this package itself imports nothing, so that it costs nothing.
"""
