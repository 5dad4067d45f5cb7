"""The commands ``physic setup`` and ``physic weights fetch``."""
