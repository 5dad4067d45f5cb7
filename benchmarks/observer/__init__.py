"""Fit the embedded observer of people to labelled photos."""
