"""Find installed plugins, and their backends, weights and commands."""
