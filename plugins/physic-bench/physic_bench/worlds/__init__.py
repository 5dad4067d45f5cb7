"""Benchmarks of the engine: accuracy on worlds and speed."""
