"""Segment people and floor."""
