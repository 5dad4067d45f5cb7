"""People's masks and the floor's mask."""
