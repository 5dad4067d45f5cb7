"""Find installed plugins, and their backends, weights, commands, executors and exporters."""
