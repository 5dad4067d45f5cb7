"""The optimization engine: scene (stage 1), placement of people (stage 2), joint (stage 3), contact
map.

Inputs and outputs are torch tensors. The engine does not use configs, files or plugins. Import its
modules by name; this package imports nothing.
"""
