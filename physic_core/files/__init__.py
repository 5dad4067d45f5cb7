"""Atomic writes, npz archives with verified checksums, and JSON with non-finite numbers.

Other packages use :mod:`.atomic` for folders that are written as a whole, :mod:`.own` for files that may be replaced,
:mod:`.archive` and :mod:`.npz` for arrays, :mod:`.strict_json` and :mod:`.csv_rows` for text, :mod:`.quoting` for text
in messages, :mod:`.image_file` for photos, :mod:`.regular` for files of unknown origin, and :mod:`.locks`.
"""
