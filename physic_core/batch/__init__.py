"""Reconstruct many photos: find them, run them in worker processes, keep a journal, and write tables and pages."""
