"""Stage 3: people and scene optimised together (paper Sec. 3.3)."""
