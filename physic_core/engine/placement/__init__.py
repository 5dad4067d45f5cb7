"""Stage 2: people's points in the scene, and the translation of each body (paper Sec. 3.2)."""
