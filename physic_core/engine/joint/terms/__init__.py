"""The terms of the joint energy, one file each: its settings, its equation, and its weights."""
