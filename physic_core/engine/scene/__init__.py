"""Stage 1: metric scene points, camera and floor (paper Sec. 3.1)."""
