"""Attacks with damaged and hostile input, for the tests."""
