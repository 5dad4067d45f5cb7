"""Atomic writes, npz archives with verified checksums, and JSON with non-finite numbers.

Other packages use :mod:`.atomic` for files that are written completely or not at all, files that
may be replaced and files of unknown origin, :mod:`.plain` for dataclasses, :mod:`.npz` for arrays,
:mod:`.text` for text and JSON, and :mod:`.image_file` for photos.
"""
