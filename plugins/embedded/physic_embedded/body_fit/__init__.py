"""Fit the embedded body model and its fingers to landmarks."""
