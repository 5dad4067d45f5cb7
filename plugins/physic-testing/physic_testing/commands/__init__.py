"""The commands that physic-testing adds to ``physic``."""
