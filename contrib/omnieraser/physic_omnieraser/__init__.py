"""Inpainting backend: OmniEraser on FLUX.1-dev."""
