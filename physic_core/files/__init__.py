"""Atomic writes, npz archives with verified checksums, and JSON with non-finite numbers.

Other packages use :mod:`.atomic` for files that are written completely or not at all, :mod:`.own` for files that may be
replaced, :mod:`.plain` for dataclasses, :mod:`.npz` for arrays, :mod:`.strict_json` and :mod:`.csv_rows` for text,
:mod:`.quoting` for text in messages, :mod:`.image_file` for photos, and :mod:`.regular` for files of unknown origin.
"""
