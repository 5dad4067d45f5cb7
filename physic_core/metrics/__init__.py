"""Metrics of a reconstruction against ground truth."""
