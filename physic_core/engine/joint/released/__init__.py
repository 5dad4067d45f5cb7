"""Preset "release": parts of the paper's released code that differ from the equations of the paper."""
