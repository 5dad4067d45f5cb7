"""The embedded body, and its fingers, fitted to landmarks."""
