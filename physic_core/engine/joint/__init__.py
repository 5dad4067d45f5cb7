"""Stage 3: joint optimisation of people and scene (paper Sec. 3.3)."""
