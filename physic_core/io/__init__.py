"""Photos in, results out: everything that touches files."""
