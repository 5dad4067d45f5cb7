"""From presets, files, environment and flags to one validated configuration, and from it to backends."""
