"""Find installed plugins, and their backends, weights, commands, executors and exporters.

Other packages use ``discover`` of :mod:`.plugins`, the ``Registry`` of :mod:`.registry`, records of backends and
commands in :mod:`.records` and :mod:`.offers`, and :mod:`.installed`, :mod:`.registration` and :mod:`.exporters` for
what else plugins add. :mod:`.local_modules` finds a user's own backend. :mod:`.plugin_code` runs code of plugins, and
:mod:`.error_text` reports its errors. :mod:`.readiness`, :mod:`.catalog` and :mod:`.close_names` give hints.
"""
