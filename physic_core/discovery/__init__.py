"""Find what installed plugins offer: backends by entry points, and what else they add by hooks.

Other packages use :mod:`.backends`, :mod:`.plugins`, :mod:`.hooks`, :mod:`.local_modules`,
:mod:`.plugin_code`, :mod:`.process_state` and the versions of :mod:`.entry_points`; for messages
also :mod:`.error_text` and :mod:`.catalog`.
"""
