"""Which plugins are installed, and which backends, weights and commands they offer."""
