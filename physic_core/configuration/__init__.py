"""Build one validated configuration from presets, files, environment and flags, and backends from it."""
