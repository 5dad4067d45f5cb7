"""Stage 2: human points in the scene, and the translation of each body (paper Sec. 3.2)."""
