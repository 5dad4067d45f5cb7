"""Accuracy of the engine on worlds."""
