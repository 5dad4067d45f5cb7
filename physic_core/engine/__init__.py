"""The fixed optimisation: scene (stage 1), human (stage 2), joint (stage 3), contact map.

Torch in, torch out; the engine knows nothing of configs, files or plugins. Import the modules by name; this package
itself imports nothing.
"""
