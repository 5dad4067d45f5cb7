"""Commands that physic-testing adds to ``physic``."""
