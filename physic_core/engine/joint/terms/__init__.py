"""The terms of the joint energy, one file each: its settings, its equation, and what takes part in it."""
