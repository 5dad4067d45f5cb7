"""Attacks with damaged and hostile input, shared by the tests and by ``fuzz.py``."""
