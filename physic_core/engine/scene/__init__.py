"""Stage 1: the scene in metres, with its camera and floor (paper Sec. 3.1)."""
