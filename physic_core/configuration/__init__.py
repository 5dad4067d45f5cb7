"""Build one validated configuration from presets, files, environment and flags, and backends from
it.

Other packages use ``Config``, ``load_config`` and presets of the engine of :mod:`.model`, and
``resolve`` and ``ResolvedPipeline`` of :mod:`.resolve`.
"""
