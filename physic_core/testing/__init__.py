"""For tests, of the core and of plugins: synthetic worlds with ground truth."""
