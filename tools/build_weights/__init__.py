"""Makes the networks of physic-embedded again, from registry packages; see ``__main__``."""
