"""Build one validated configuration from presets, files, environment and flags, and backends from it.

Other packages use ``Config`` and ``load_config`` of :mod:`.model`, ``resolve`` and ``ResolvedPipeline`` of
:mod:`.resolve`, and :mod:`.energies` for presets of the engine.
"""
